"""What several tests share: the Nile flows, and where the real recordings lie."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from board_fixtures import start_board, stream_sketch, workshop

__all__ = ["start_board", "stream_sketch", "workshop"]  # fixtures for every folder

ROOT = Path(__file__).parents[1]
SHARED_DATA = ROOT.parent / "shared" / "data"
REQUIRE_ALL = os.environ.get("KALSCOPE_REQUIRE") == "all"


@pytest.fixture(scope="session")
def nile():
    """The Nile flows at Aswan 1871-1970, 1e8 m³, shape (100,)."""
    return np.loadtxt(
        (line for line in (ROOT / "sample_data" / "nile.csv").read_text().splitlines() if line[:1].isdigit()),
        delimiter=",",
    )[:, 1]
