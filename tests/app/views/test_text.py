"""Values in text boxes, and names from outside the program."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope_app.views.text import escape_markdown, typed


@pytest.mark.parametrize(
    ("value", "text"),
    [(1e-9, "1e-9"), (0.0589, "0.0589"), (1e300, "1e300"), (0.0, "0"), (1469.18, "1469.18")],
)
def test_typed(value, text):
    assert typed(value) == text


@given(st.floats(1e-300, 1e300))
def test_typed_reads_back_to_eight_digits(value):
    assert float(typed(value)) == pytest.approx(value, rel=1e-7)


@given(st.text(max_size=200))
def test_a_name_from_outside_carries_no_live_markup(name):
    shown = escape_markdown(name)
    assert "\n" not in shown
    assert len(shown) <= 122
    for i, mark in enumerate(shown):
        if mark in "<>&`[]!*_|#":
            assert shown[i - 1] == "\\"


def test_a_number_stays_on_one_line():
    assert escape_markdown("rows 2\u202f289\n to\t3") == "rows 2\u202f289 to 3"
