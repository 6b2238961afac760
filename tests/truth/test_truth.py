"""Nothing that was found, filtered, judged, said or exported before may change by accident.

Where a change is meant: `python tests/truth/store.py`, and read the differences.
"""

from __future__ import annotations

from itertools import islice

import pytest
from tests.support.effort import FUZZ
from tests.truth.truth_cases import ROOTS, SETS, changes, groups_of, stored

NO_DATA = pytest.mark.skipif(not ROOTS["shared"].is_dir(), reason="shared/data is not beside the repository")
FAST = ("exports", "words")
CHANNELS = 2 if FUZZ == 1 else None
"""Channels of each real recording that the ordinary run looks at; `make soak` looks at all of them."""


def marks(group: str) -> list[pytest.MarkDecorator]:
    return [pytest.mark.slow] * (not group.startswith(FAST)) + [NO_DATA] * group.startswith("shared/")


@pytest.mark.parametrize(
    ("name", "group"),
    [pytest.param(name, group, marks=marks(group)) for name in SETS for group in groups_of(name) | stored(name)],
)
def test_every_stored_case_comes_out_again(name, group, capsys):
    most = CHANNELS if group.startswith("shared/") else None
    old = dict(islice(stored(name).get(group, {}).items(), most))
    cases = groups_of(name)[group]() if group in groups_of(name) else ()
    wrong, better = changes(old, {case["id"]: case for case in islice(cases, most)})
    with capsys.disabled():
        print(*better, sep="\n", end="\n" if better else "")
    assert not wrong, f"{len(wrong)} differences\n" + "\n".join(wrong[:40])
