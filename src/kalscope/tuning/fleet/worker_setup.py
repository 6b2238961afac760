"""What a worker of this machine does first; Dask loads this module in it by name."""

from __future__ import annotations

import signal


def dask_setup(_worker: object) -> None:
    """Leave Ctrl+C to the driver: a terminal sends it to every process of the run."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
