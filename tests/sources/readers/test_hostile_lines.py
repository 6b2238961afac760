"""One hostile line must not hold up the reader: the processor's time for it grows in proportion to its length."""

import time
from contextlib import suppress
from itertools import product

import pytest

from kalscope.errors import BadFile

pytestmark = pytest.mark.slow

HEADS = {
    "a table": [f"{0.01 * i:.2f},{20 + i % 7},{i % 5}.5" for i in range(60)],
    "labels": [f"a:{i},b:{i}.5" for i in range(60)],
    "blank labels": [f'{{" ": {i}, "a": {i}.5}}' for i in range(60)],
}
LEADS = ("", "# unit ", "a:", "1,2,", "2024-01-01 ")
RUNS = (*' 1.,:-"a=(/e\t', "1 ", "1,", "a:1 ", "a:", "1.", ' "', "[]")
SIZE, MAX_SECONDS = 20_000, 0.5
"""Letters of the line, and what the processor may take for its file: it takes 0.03 s or less."""


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("place", [0, 30])
def test_a_file_with_a_line_of_20_kb_is_soon_read_or_refused(read, head, place):
    rows = HEADS[head]
    assert len(read("\n".join([*rows, ""]))) == len(rows)
    for lead, run in product(LEADS, RUNS):
        line = lead + run * (SIZE // len(run)) + "x"
        start = time.thread_time()
        with suppress(BadFile):
            assert len(read("\n".join([*rows[:place], line, *rows[place:], ""]))) >= len(rows)
        assert time.thread_time() - start < MAX_SECONDS, (lead, run)
