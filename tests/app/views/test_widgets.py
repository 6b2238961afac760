"""What widgets and the header show: numbers that read back, places on a slider, names without markup."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import open_source
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.charts import drawable, range_text, scale_for, time_scale_for
from kalscope_app.views.tune import on_decades
from kalscope_app.views.widgets import escape_markdown, typed
from kalscope_app.views.window import figures, record_line


@given(st.floats(1e-300, 1e300))
def test_what_a_box_shows_reads_back_to_seven_digits(value):
    assert float(typed(value)) == pytest.approx(value, rel=1e-6)
    assert "e-0" not in typed(value)


def test_a_slider_ends_at_automatic_on_its_right():
    for value, place in (None, 7.0), (100.0, 2.0), (0.0, -6.0), (1e-9, -6.0), (1e9, 6.0):
        assert on_decades(value, -6, 6, "automatic") == (place, ((-6.0, ""), (7.0, "automatic")))
    assert on_decades(1.0, -6, 6) == (0.0, ((-6.0, "1e-6"), (6.0, "1e6")))


@given(st.text(max_size=200))
def test_a_name_from_outside_carries_no_live_markup(name):
    shown = escape_markdown(name)
    assert "\n" not in shown
    assert len(shown) <= 122
    assert all(shown[i - 1] == "\\" for i, mark in enumerate(shown) if mark in "<>&`[]!*_|#")
    assert escape_markdown("rows 2\u202f289\n to\t3") == "rows 2\u202f289 to 3"  # no break within a number


@pytest.mark.slow
def test_the_header_of_a_recording_without_a_rate_counts_in_samples():
    unknown = replace(open_source("demo"), sample_period=None)
    assert record_line(unknown) == "**Bending finger** · sample rate unknown"
    assert "**0.618 samples** lag" in re.sub("<[^>]*>", "", figures(compute_frame(opened(unknown))))


# --- what may reach uPlot: it goes blank on NaN in front, on inf and on empty arrays --------------------


NAN, INF = math.nan, math.inf


def test_every_y_becomes_finite_and_every_record_a_line():
    for y, drawn in (
        *(([NAN, 2, 3], [2, 2, 3]), ([1, NAN, 3], [1, 1, 3]), ([1, 2, NAN], [1, 2, 2])),
        *(([INF, 2, -INF], [2, 2, 2]), ([NAN, NAN, NAN], [0, 0, 0]), ([], [0, 0]), ([7], [7, 7])),
    ):
        x, seen = drawable(np.arange(float(len(y))), [np.array(y, dtype=float)])
        assert (x.tolist(), seen.tolist()) == ([0, 1, 2][: max(len(y), 2)], drawn)


def test_small_and_large_signals_and_spans_are_brought_to_readable_numbers():
    for largest, unit, factor, shown in (
        *((3.3, "V", 1.0, "V"), (0.012, "V", 1e3, "mV"), (0.3, "V", 1e3, "mV"), (2e5, "Pa", 1e-3, "kPa")),
        *((2e-6, "counts", 1e6, "1e-6 counts"), (5e-5, "", 1e6, "1e-6"), (0.04, "", 1e3, "1e-3")),
        *((0.0, "V", 1.0, "V"), (1e-300, "V", 1e300, "1e-300 V"), (1023.0, "counts", 1.0, "counts")),
    ):
        scale = scale_for(np.array([0.0, -largest, NAN]), unit)
        assert (scale.factor, scale.unit) == (pytest.approx(factor), shown)
    for span, period, unit in (
        *((0.5, 1e-3, "s"), (0.03, 1e-3, "ms"), (300.0, 0.01, "min"), (86400.0, 60.0, "h")),
        *((3e9, 3e7, "years"), (1e-9, 1e-12, "ms"), (100.0, None, "samples")),
    ):
        assert time_scale_for(span, period).unit == unit


def test_the_ends_of_the_view_are_told_apart_and_no_longer_than_that():
    for first, last, text in (
        *((-0.000446, 4.5501, "0 to 4.55"), (0.007, 4.9851, "0.007 to 4.99"), (0.0, 35.6123, "0 to 35.6")),
        *((22.2221, 22.2263, "22.2221 to 22.2263"), (0.0, 0.0390625, "0 to 0.0391"), (5.0, 5.0, "5 to 5")),
        (1_234_567.0, 1_234_568.0, "1.234567e6 to 1.234568e6"),
        *((0.0, 1e-310, "0 to 1e-310"), (-1.7e308, 1.7e308, "−1.7e308 to 1.7e308")),
    ):
        assert range_text(first, last) == text
