"""Fixtures: a real Arduino program in a simulated Uno. A missing tool is a skip with its name, or a failure.

They stand in tests/conftest.py, so that tests of the sources and of the dashboard may start a board as well.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from numpy.typing import ArrayLike
from tests.support.board import SKETCHES, Firmware, Uno, Workshop, missing, write_counts
from tests.support.required import not_here

StartBoard = Callable[..., Uno]


@pytest.fixture(scope="session")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Workshop:
    """Compiles sketches."""
    if lacking := missing():
        not_here(f"not installed: {', '.join(lacking)}")
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # all workers share it
    folder /= "workshop"
    folder.mkdir(exist_ok=True)
    return Workshop(folder)


@pytest.fixture(scope="session")
def stream_sketch(workshop: Workshop) -> Firmware:
    """Our streaming sketch as it is shipped."""
    return workshop.sketch(SKETCHES / "kalscope_stream/kalscope_stream.ino")


@pytest.fixture
def start_board(workshop: Workshop, tmp_path: Path) -> Iterator[StartBoard]:
    """start_board(firmware, counts, *options, name="uno") -> Uno; every board is stopped at the end of the test."""
    boards: list[Uno] = []

    def start(firmware: Firmware, counts: ArrayLike = 512, *options: object, name: str = "uno") -> Uno:
        adc = write_counts(tmp_path / f"{name}-counts.txt", counts)
        port, log = tmp_path / name, tmp_path / f"{name}-{len(boards)}.log"  # a port of its own: tests do not meet
        boards.append(Uno(workshop.uno, firmware, port, log, ("--adc", adc, *options)))
        return boards[-1]

    yield start
    for board in boards:
        board.stop()
