"""One hostile line must not hold up the reader: the work for it grows in proportion to its length, and it ends.

The calls that are made are counted, not timed; what a pattern does within one call is counted by `test_patterns`.
"""

import sys
from contextlib import suppress
from functools import partial

import pytest

from kalscope.errors import BadFile
from kalscope.sources.grammar.read_options import DEFAULTS
from kalscope.sources.reading.line_reader import LineReader
from kalscope.sources.reading.sniffer import sniff

pytestmark = pytest.mark.slow

ROWS = [f"{0.01 * i:.2f},{20 + i % 7},{i % 5}.5" for i in range(60)]
LABELLED = [f"a:{i},b:{i}.5" for i in range(20)]
BLANK_LABELS = [f'{{" ": {i}, "a": {i}.5}}' for i in range(20)]
SMALL, LARGE = 800, 3200
MAX_RATIO = 1.5 * LARGE / SMALL
MIN_CALLS = 10_000
"""Fewer calls at the large size are no hold-up, however they grow."""
LEADS = ("", "# unit ", "a:", "1,2,", "2024-01-01 ")
RUNS = (*' 1.,:-"a=(/e\t', "1 ", "1,", "a:1 ", "a:", "1.", ' "', "[]")


def count_calls(work):
    """Functions, Python's and C's, that are called."""
    count = 0

    def note(frame, event, arg):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


def hostile(size, lead, run, breaker="x"):
    return lead + run * ((size - len(lead) - 1) // len(run)) + breaker


def check(work):
    """`work` of a text takes calls in proportion to its length, beyond those of a harmless one."""
    work("1,2,3")
    for lead in LEADS:
        for run in RUNS:
            if (large := count_calls(partial(work, hostile(LARGE, lead, run)))) >= MIN_CALLS:
                small = count_calls(partial(work, hostile(SMALL, lead, run)))
                assert large <= MAX_RATIO * small, f"{hostile(30, lead, run)!r}: {small}, {large}"


@pytest.mark.parametrize("place", [0, 10])
def test_finding_the_layout_takes_calls_in_proportion_to_a_line(place):
    check(lambda text: sniff([*ROWS[:place], text, *ROWS[place:20]], DEFAULTS))


@pytest.mark.parametrize("head", [ROWS, LABELLED, BLANK_LABELS])
def test_reading_a_line_takes_calls_in_proportion_to_it(head):
    layout = sniff(head, DEFAULTS)
    reader = LineReader(layout)
    check(lambda text: reader.read(1, text))


@pytest.mark.parametrize("lead", ["", "# unit ", "a:", "1,"])
@pytest.mark.parametrize("run", [" ", "1", ":", '"', "1,"])
def test_a_file_with_a_line_of_64_kb_is_read_or_refused(read, lead, run):
    with suppress(BadFile):
        assert len(read("\n".join([*ROWS[:30], hostile(64_000, lead, run), *ROWS[30:], ""]))) >= len(ROWS)
