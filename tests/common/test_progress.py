"""Progress of a task and of its parts, and stopping it."""

from __future__ import annotations

import pytest

from kalscope.common.progress import Progress
from kalscope.errors import Cancelled


def test_a_part_of_a_part_reports_the_fraction_of_the_whole():
    seen = []
    part = Progress(lambda fraction, text: seen.append((round(fraction, 9), text))).part(0.5, 1.0).part(0.2, 0.6)
    for fraction in (-1.0, 0.0, 0.5, 1.0, 2.0):
        part(fraction, "x")
    assert seen == [(0.6, "x"), (0.6, "x"), (0.7, "x"), (0.8, "x"), (0.8, "x")]


def test_every_part_stops_when_the_task_is_cancelled():
    stop = False
    part = Progress(None, lambda: stop).part(0.0, 0.5)
    part(0.1, "goes on without a report")
    stop = True
    with pytest.raises(Cancelled, match="cancelled before it was finished"):
        part(0.2, "x")
