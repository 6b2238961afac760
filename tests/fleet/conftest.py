"""Workers of this process for the runs of a fleet."""

from __future__ import annotations

from contextlib import nullcontext
from importlib.util import find_spec

import pytest
from tests.support.required import REQUIRE_ALL

if not REQUIRE_ALL and not all(map(find_spec, ("dask", "distributed", "psutil", "pyarrow"))):
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture
def at_once(monkeypatch):
    """Workers without processes: those of each run."""
    from tests.fleet.fleet_runs import AtOnce

    from kalscope.fleet import run as fleet_run

    made = []

    def opened(_address, _tasks):
        made.append(AtOnce())
        return nullcontext(made[-1])

    monkeypatch.setattr(fleet_run, "open_workers", opened)
    return made
