"""What all tests share: profiles and markers of a run, the Nile flows, and where the real recordings lie."""

from __future__ import annotations

import atexit
import gc
import os
import signal
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import chain, islice
from pathlib import Path

import numpy as np
import pytest
import typer
from board_fixtures import start_board, stream_sketch, workshop
from effort import EXAMPLES, FUZZ
from hypothesis import settings
from markers import mark
from waiting import PATIENCE

from kalscope.cli.app import COMMANDS
from kalscope.export import board
from kalscope.sources.live import source

__all__ = ["start_board", "stream_sketch", "workshop"]  # fixtures for every folder

ROOT = Path(__file__).parents[1]
SHARED_DATA = ROOT.parent / "shared" / "data"

LONG = {"browser": 30, "device": 2, "server": 1, "slow": 1}
"""Markers of tests that take long, and about how many times as long as a slow one."""

STARTED = {"attack_table", "forked", "program"}
"""Modules whose programs come from the fork server that a worker keeps to its end."""

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
    """Mark what needs a browser, a simulated board, a server or another process: each worker begins with some."""
    for item in items:
        mark(item)
    items[:] = in_shares(items, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))


def pytest_collection_finish() -> None:
    """Look for garbage again, until the end without the modules and tests, which all stay so long."""
    gc.freeze()
    gc.enable()
    atexit.register(gc.unfreeze)


def in_shares(items: list[pytest.Item], workers: int) -> list[pytest.Item]:
    """The items in the equal shares that xdist gives its workers, each with as much work of long tests first.

    The long tests of a file stay together, because they may share a program. Those with a browser or the program
    stay on half of the workers: each of these starts its own. The short ones, of which a worker that is done takes
    from the others, keep all of them busy to the end.
    """
    files, short = defaultdict[Path, list[pytest.Item]](list), list[pytest.Item]()
    for item in items:
        (files[item.path] if work_of(item) else short).append(item)
    shares, work = [list[pytest.Item]() for _ in range(workers)], [0] * workers
    for amount, file in sorted(
        ((sum(map(work_of, file)), file) for file in files.values()), key=lambda one: -one[0]
    ):
        place = work.index(min(work[: (workers + 1) // 2] if starts_a_program(file) else work))
        shares[place].extend(file)
        work[place] += amount
    left = iter(short)
    for place, share in enumerate(shares):
        full = len(items) * (place + 1) // workers - len(items) * place // workers
        share.extend(islice(left, max(full - len(share), 0)))
    return [*chain(*shares), *left]


def work_of(item: pytest.Item) -> int:
    """How long a test takes beside the others; 0 = not long."""
    return max((work for marker, work in LONG.items() if item.get_closest_marker(marker)), default=0)


def starts_a_program(items: list[pytest.Item]) -> bool:
    """Whether any test needs a browser, or its module the fork server."""
    named = {getattr(value, "__module__", None) for value in vars(items[0].module).values()}
    return bool(named & STARTED) or any(item.get_closest_marker("browser") for item in items)


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
        patch.setattr(source, "ANSWER_S", PATIENCE)
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
def nile():
    """The Nile flows at Aswan 1871-1970, 1e8 m³, shape (100,)."""
    return np.loadtxt(
        (line for line in (ROOT / "sample_data" / "nile.csv").read_text().splitlines() if line[:1].isdigit()),
        delimiter=",",
    )[:, 1]
