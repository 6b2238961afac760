"""Names from outside the program in markdown."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from kalscope_app.views.widgets import escape_markdown


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
