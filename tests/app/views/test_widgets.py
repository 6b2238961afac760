"""What widgets and the header show: numbers that read back, places on a slider, names without markup."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import open_source
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.tune import on_decades
from kalscope_app.views.widgets import escape_markdown, typed
from kalscope_app.views.window import figures, record_line


@given(st.floats(1e-300, 1e300))
def test_what_a_box_shows_reads_back_to_seven_digits(value):
    assert float(typed(value)) == pytest.approx(value, rel=1e-6)
    assert "e-0" not in typed(value)


@pytest.mark.parametrize(("value", "place"), [(None, 7.0), (100.0, 2.0), (0.0, -6.0), (1e-9, -6.0), (1e9, 6.0)])
def test_a_slider_ends_at_automatic_on_its_right(value, place):
    assert on_decades(value, -6, 6, "automatic") == (place, ((-6.0, ""), (7.0, "automatic")))
    assert on_decades(1.0, -6, 6) == (0.0, ((-6.0, "1e-6"), (6.0, "1e6")))


@given(st.text(max_size=200))
def test_a_name_from_outside_carries_no_live_markup(name):
    shown = escape_markdown(name)
    assert "\n" not in shown
    assert len(shown) <= 122
    assert all(shown[i - 1] == "\\" for i, mark in enumerate(shown) if mark in "<>&`[]!*_|#")
    assert escape_markdown("rows 2\u202f289\n to\t3") == "rows 2\u202f289 to 3"  # no break within a number


def said(record):
    """The texts of the figures."""
    return re.sub("<[^>]*>", "", figures(compute_frame(opened(record))))


def test_the_header_names_the_recording_its_rate_the_lag_and_the_noise():
    demo = open_source("demo")
    assert record_line(demo) == "**Bending finger** · 50.0 Hz"
    assert said(demo) == "**12.4 ms** lag **52 %** noise left (−5.65 dB)"
    hostile = replace(demo, title="<img src=x> *a* [b](c)")
    assert record_line(hostile).startswith(r"**\<img src\=x\> \*a\* \[b\]\(c\)**")
    unknown = replace(demo, sample_period=None)
    assert record_line(unknown).endswith("sample rate unknown")
    assert said(unknown).startswith("**0.618 samples** lag")
