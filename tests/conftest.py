"""What all tests share: profiles and markers of a run, records of the literature, an Arduino in a simulated Uno."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer
from hypothesis import settings
from numpy.typing import ArrayLike

from kalscope.cli.app import COMMANDS
from kalscope.export import board
from kalscope.sources.live import source
from tests.support.board import SKETCHES, Firmware, Uno, Workshop, missing, write_counts
from tests.support.effort import EXAMPLES, FUZZ
from tests.support.required import not_here
from tests.support.waiting import PATIENCE

ROOT = Path(__file__).parents[1]

STARTERS = {
    "tests.app.attack_table",
    "tests.support.forked",
    "tests.app.headless",
    "tests.support.program",
    "tests.app.wire",
    "kalscope_app.guard.server",
    "kalscope_app.worker.worker",
}
"""Modules whose functions and classes start or meet a server or the program."""
ORDER = ["browser", "device", "server", "slow"]
"""The markers of long tests, the longest first."""

# No deadline: a busy machine is no failure. The ordinary run repeats its examples; `make soak` looks for new ones.
settings.register_profile("kalscope", max_examples=EXAMPLES, deadline=None, derandomize=FUZZ == 1)
settings.load_profile("kalscope")


def pytest_configure() -> None:
    """Restore the signals that this run was started to ignore: every program that a test starts inherits that.

    A shell starts its background jobs with SIGINT ignored, and nohup its command with SIGHUP. While tests are
    collected almost nothing becomes garbage: looking for it takes a quarter of the time.
    """
    gc.disable()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if os.name == "posix" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test by what it or its module starts, and begin with the files whose tests take longest."""
    ranks = dict[Path, int]()
    for item in items:
        fixtures = set(getattr(item, "fixturenames", ()))
        for marker, starters in (("browser", {"browser", "firefox"}), ("device", {"workshop"})):
            if fixtures & starters:
                item.add_marker(marker)
        if starts_a_process(item.module):
            item.add_marker("server")
        rank = min((i for i, marker in enumerate(ORDER) if item.get_closest_marker(marker)), default=len(ORDER))
        ranks[item.path] = min(rank, ranks.get(item.path, rank))
    items.sort(key=lambda item: ranks[item.path])


@cache
def starts_a_process(module: ModuleType) -> bool:
    """Whether a test module imports what starts a process, a server or a pseudo-terminal."""
    return any(
        value is subprocess or getattr(value, "__module__", None) in STARTERS for value in vars(module).values()
    )


def pytest_collection_finish() -> None:
    """Look for garbage again, until the end without the modules and tests, which all stay so long."""
    gc.freeze()
    gc.enable()
    atexit.register(gc.unfreeze)


@pytest.fixture(scope="session", autouse=True)
def one_command_line() -> Iterator[None]:
    """Build the commands once a worker; typer builds them again at each run in its process, which takes 15 ms."""
    build = typer.main.get_command
    built = cache(lambda app, _commands: build(app))  # the dashboard adds a command of its own when it is imported
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", lambda app: built(app, len(COMMANDS)))
        yield


@pytest.fixture(scope="session", autouse=True)
def patient_with_boards() -> Iterator[None]:
    """Wait for the answer of a board as long as for everything else: a busy machine is no board that is silent."""
    with pytest.MonkeyPatch.context() as patch:
        for send in (source.CommandChannel.send, source.LiveSource.send):
            patch.setattr(send, "__defaults__", (PATIENCE,))
        patch.setattr(board, "ANSWER_S", PATIENCE)
        patch.setattr(board, "_CANCEL_S", PATIENCE)
        yield


STATES: dict[str, dict[str, object]] = {}
"""The state of each module's random generator before its first test."""


@pytest.fixture(autouse=True)
def same_draws(request: pytest.FixtureRequest) -> None:
    """Every test draws the same numbers from the generator of its module, whatever its worker ran before it."""
    if (generator := getattr(request.module, "RNG", None)) is not None:
        generator.bit_generator.state = STATES.setdefault(request.module.__name__, generator.bit_generator.state)


@pytest.fixture(scope="session")
def norway():
    """Road deaths in Norway 1970-2003 (Commandeur & Koopman 2007, appendix A), shape (34,)."""
    first = [560.0, 533, 490, 511, 509, 539, 471, 442, 434, 437, 362, 338, 401, 409, 407, 402, 452]
    return np.array([*first, 398, 378, 381, 332, 323, 325, 281, 283, 305, 255, 303, 352, 304, 341, 275, 312, 280])


@pytest.fixture(scope="session")
def nile():
    """The Nile flows at Aswan 1871-1970, 1e8 m³, shape (100,)."""
    return np.loadtxt(
        (line for line in (ROOT / "sample_data" / "nile.csv").read_text().splitlines() if line[:1].isdigit()),
        delimiter=",",
    )[:, 1]


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
def start_board(workshop: Workshop, tmp_path: Path) -> Iterator[Callable[..., Uno]]:
    """start_board(firmware, counts, *options, name="uno") -> Uno; every board is stopped at the end of the test."""
    boards: list[Uno] = []

    def start(firmware: Firmware, counts: ArrayLike = 512, *options: object, name: str = "uno") -> Uno:
        adc = write_counts(tmp_path / f"{name}-counts.txt", counts)
        port, log = tmp_path / name, tmp_path / f"{name}-{len(boards)}.log"  # a port of its own: tests do not meet
        boards.append(Uno(workshop.uno, firmware, port, log, ("--adc", adc, *options)))
        return boards[-1]

    yield start
    for one in boards:
        one.stop()
