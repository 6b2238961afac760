"""The header: what is open and at which rate, and two large figures."""

from __future__ import annotations

import re
from dataclasses import replace

from kalscope import open_source
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.opening import opened
from kalscope_app.views.window import figures, record_line


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
