"""Logs in random dialects, as loggers write them: read exactly, refused or asked about, never wrong without a word.

50 logs in the ordinary run, 5,000 in `make soak`. A failure names seeds: `make_case(seed)` writes that log again.
"""

from collections import Counter

import pytest
from dialects.verdict import judge, make_case, named_options
from effort import FUZZ

from kalscope.sources.grammar.read_options import ReadOptions

pytestmark = pytest.mark.slow

COUNT = 50 if FUZZ == 1 else 200 * FUZZ
RARE = (1225, 1299, 1344, 1413, 1764, 2118, 2138)
"""Seeds of settings above nameless rows, units that begin with %, first rows without samples, an added field."""
MIN_EXACT = 0.99


def verdicts(tmp_path):
    """(seed, verdict, why) of every log."""
    path = tmp_path / "log.txt"
    return [(seed, *judge(make_case(seed), path)) for seed in (*range(COUNT), *RARE)]


def test_a_log_in_any_dialect_is_read_exactly_or_not_at_all(tmp_path):
    found = verdicts(tmp_path)
    counts = Counter(verdict for _, verdict, _ in found)
    told = "\n".join(f"seed {seed}: {verdict}: {why[:120]}" for seed, verdict, why in found if verdict != "exact")
    assert not counts["wrong"], f"{counts}\n{told[:4000]}"
    assert counts["exact"] >= MIN_EXACT * COUNT, f"{counts}\n{told[:4000]}"


def test_a_seed_always_writes_the_same_log():
    assert make_case(7).data == make_case(7).data
    assert len({make_case(seed).data for seed in range(20)}) == 20


@pytest.mark.parametrize(
    ("note", "options"),
    [
        ("it could also be 1 column: --delimiter semicolon --decimal comma", {"delimiter": ";", "decimal": ","}),
        ('the time could also be "my t": --time-column "my t"', {"time_column": "my t"}),
        ("they could also be month first: --month-first", {"day_first": False}),
        ("stamps are read as s (assumed from their size: --time-unit changes it)", None),
        ("is this a number?", None),
    ],
)
def test_a_question_is_a_note_that_names_the_option_which_mends_the_reading(note, options):
    assert named_options(note) == (None if options is None else ReadOptions(**options))
