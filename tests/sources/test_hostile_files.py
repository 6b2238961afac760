"""No hostile file costs more than it may, or ends in anything but a recording or one line that says why not.

The files are read in processes of their own, whose memory is measured by
its peak. `make soak` reads the large ones.
"""

from __future__ import annotations

import re

import pytest
from tests.support.effort import FUZZ
from tests.support.forked import fork_server
from tests.support.hostile_case import examine_all, in_child
from tests.support.required import needs

needs("duckdb", "h5py", "nptdms", "python_calamine", "zstandard")

from tests.sources.hostile_files import PACKED, SPECIAL, TEXTS  # noqa: E402

from kalscope.common.text import CONTROL  # noqa: E402

pytestmark = pytest.mark.slow

BIG = FUZZ > 1
CASES = [case for case in (*TEXTS, *PACKED, *SPECIAL) if BIG or case.small]


AT_ONCE = 1 if BIG else 5
"""Files of one name that share a process: to read a small one takes less time than a process."""
BATCHES = [
    cases[at : at + AT_ONCE]
    for file in sorted({case.file for case in CASES})
    for cases in ([case for case in CASES if case.file == file],)
    for at in range(0, len(cases), AT_ONCE)
]


@pytest.mark.parametrize("cases", BATCHES, ids=lambda cases: f"{cases[0].name} …")
def test_hostile_files_are_read_or_refused_in_bounded_memory(tmp_path, monkeypatch, cases):
    """What the files of a process add to its peak stays together below every bound of theirs."""
    files = []
    for at, case in enumerate(cases):
        path = tmp_path / f"{at}" / case.file
        path.parent.mkdir()
        monkeypatch.chdir(path.parent)  # the path of a socket must be short
        case.make(path, case.big if BIG else case.small)
        files.append((path, case.during))
    seen = in_child(fork_server(), examine_all, files)
    assert isinstance(seen, list), seen.outcome
    outcomes = {case.name: one.outcome for case, one in zip(cases, seen, strict=True)}
    for case in cases:
        assert re.match(case.expects(big=BIG), outcomes[case.name]), (case.name, outcomes[case.name])
    assert not CONTROL.search("".join(outcomes.values()))
    added = {case.name: one.mib for case, one in zip(cases, seen, strict=True) if one.mib}
    assert sum(added.values()) <= min(case.big_mib if BIG else case.mib for case in cases), added
    if BIG and files[0][0].is_file():
        files[0][0].unlink()  # the large ones would fill the disk
