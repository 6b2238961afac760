"""Workers of this process for the runs of a fleet."""

from __future__ import annotations

from contextlib import contextmanager

import pytest
from fleet_runs import AtOnce

from kalscope.fleet import run as fleet_run


@pytest.fixture
def at_once(monkeypatch):
    """Workers without processes, and the fault that they have."""
    faults, made = [], []

    @contextmanager
    def opened(_address, _tasks):
        made.append(AtOnce(lambda units: faults[0](units) if faults else None))
        yield made[-1]

    monkeypatch.setattr(fleet_run, "open_workers", opened)
    return faults, made
