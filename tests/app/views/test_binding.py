from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope_app.views.widgets import put, typed


class Handle:
    def __init__(self):
        object.__setattr__(self, "written", [])
        self.label, self.visible = "a", True
        self.written.clear()

    def __setattr__(self, name, value):
        self.written.append(name)
        object.__setattr__(self, name, value)


def test_only_what_differs_is_written():
    handle = Handle()
    put(handle, label="a", visible=False)
    put(handle, label="b", visible=False)
    assert handle.written == ["visible", "label"]
    assert (handle.label, handle.visible) == ("b", False)


@pytest.mark.parametrize(
    ("value", "text"),
    [(1e-9, "1e-9"), (0.0589, "0.0589"), (1e300, "1e300"), (0.0, "0"), (1469.18, "1469.18")],
)
def test_typed(value, text):
    assert typed(value) == text


@given(st.floats(1e-300, 1e300))
def test_typed_reads_back_to_eight_digits(value):
    assert float(typed(value)) == pytest.approx(value, rel=1e-7)
