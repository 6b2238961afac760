"""What a worker of this machine does first; Dask loads this module in it by name."""

from __future__ import annotations

import signal
import tempfile
from typing import Any


def dask_setup(worker: Any) -> None:
    """Leave Ctrl+C to the driver, and temporary files too: a worker may be killed while it reads.

    A terminal sends the signal to every process of the run.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tempfile.tempdir = worker.local_directory
