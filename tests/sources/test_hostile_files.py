"""No hostile file costs more than it may, or ends in anything but a recording or one line that says why not.

The table is in `tests/support/hostile`. Each file is read in a process of its own, whose memory is measured by its
peak. `make soak` reads the large ones; `benchmarks/hostile.py` prints the table.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from each import each
from effort import FUZZ
from forked import fork_server
from hostile_case import MIB, examine, in_child
from required import needs

needs("duckdb", "h5py", "nptdms", "python_calamine", "rosbags", "mcap", "zstandard")

from packed_files import PACKED  # noqa: E402
from special_files import SPECIAL  # noqa: E402
from text_files import TEXTS  # noqa: E402

from kalscope.common.text import CONTROL  # noqa: E402

pytestmark = pytest.mark.slow

BIG = FUZZ > 1
CASES = [case for case in (*TEXTS, *PACKED, *SPECIAL) if BIG or case.small]


@each("case", CASES, ids=[case.name for case in CASES])
def test_a_hostile_file_is_read_or_refused_in_bounded_memory(tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / case.file
    case.make(path, case.big if BIG else case.small)
    seen = in_child(fork_server(), examine, path, case.during)
    assert re.match(case.expects(big=BIG), seen.outcome), seen.outcome
    assert seen.mib <= (case.big_mib if BIG else case.mib)
    assert not CONTROL.search(seen.outcome)
    if not path.is_dir():
        path.unlink(missing_ok=True)  # the large ones would fill the disk


def test_the_table_would_notice_memory_and_tracebacks(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("1,2\n" * 10)
    assert in_child(fork_server(), examine, path, fill_memory).mib > 100
    assert in_child(fork_server(), examine, path, fail).outcome.startswith("Traceback")
    assert in_child(fork_server(), examine, path, end).outcome == "the process ended with status 3"


def fill_memory(_: Path) -> int:
    return len(b"1" * (128 * MIB))


def fail(_: Path) -> None:
    raise RuntimeError


def end(_: Path) -> None:
    os._exit(3)


def test_every_case_has_a_name_of_its_own():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names) > 70
