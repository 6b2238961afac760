"""Which values a widget takes, decided without a server."""

from __future__ import annotations

import contextlib
import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from viser import _messages as messages

from kalscope_app.guard.messages import (
    MAX_BURST,
    MAX_PER_SECOND,
    MAX_TEXT,
    Misbehaviour,
    RateLimit,
    check_fields,
    fitting_value,
)

TAKEN = {
    "within the range": (0.5, 0.7, 0.0, 1.0, 0.7),
    "above": (0.5, 99, 0.0, 4.0, 4.0),
    "below": (0.5, -5, 0.001, 10.0, 0.001),
    "no range": (0.5, -1e300, None, None, -1e300),
    "a whole number for a fraction": (0.5, 1, 0.0, 1.0, 1),
    "a tick": (False, True, None, None, True),
    "two thumbs": ((0.0, 1.0), [0.2, 7], 0.0, 1.0, (0.2, 1.0)),
    "beyond every float": (0.5, 10**400, None, None, None),
    "a tick for a number": (0.5, True, None, None, None),
    "an endless text": ("a", "x" * (MAX_TEXT + 1), None, None, None),
    "one thumb too many": ((0.0, 1.0), [0.1, 0.2, 0.3], None, None, None),
    "a widget of unknown kind": (object(), 1, None, None, None),
}


@pytest.mark.parametrize(("current", "value", "low", "high", "expected"), TAKEN.values(), ids=TAKEN.keys())
def test_a_value_is_held_within_its_range_and_what_does_not_fit_is_left(current, value, low, high, expected):
    assert fitting_value(current, value, low, high) == expected
    assert fitting_value("a", value, None, None, ("a", "b")) is None  # a menu has its own words


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=2),
)


KINDS = [messages.GuiUpdateMessage, messages.GuiFormSubmitMessage, messages.GuiButtonHoldMessage]
KINDS += [messages.CommandTriggerMessage, messages.FileTransferStartUpload, messages.FileTransferPart]
KINDS += [messages.ViewerCameraMessage, messages.SceneNodeClickMessage, messages.SceneNodeDragMessage]
KINDS += [messages.ScenePointerMessage, messages.TransformControlsUpdateMessage]
"""What viser handles."""


@pytest.mark.slow
@given(st.sampled_from(KINDS), st.data())
def test_a_message_of_junk_is_judged_and_nothing_else_is_raised(kind, data):
    message = kind(**{field.name: data.draw(junk) for field in dataclasses.fields(kind) if field.init})
    with contextlib.suppress(Misbehaviour):
        check_fields(message)


def test_the_rate_limit_is_a_burst_and_then_a_rate():
    limit = RateLimit(100.0)
    assert all(limit.allows(100.0) for _ in range(int(MAX_BURST)))
    assert not limit.allows(100.0)
    limit = RateLimit(0.0)
    assert all(limit.allows(i / (0.9 * MAX_PER_SECOND)) for i in range(20 * int(MAX_BURST)))
