"""What all tests share: profiles and markers of a run, the Nile flows, and where the real recordings lie."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer
from board_fixtures import start_board, stream_sketch, workshop
from effort import EXAMPLES, FUZZ
from hypothesis import settings
from markers import mark

__all__ = ["start_board", "stream_sketch", "workshop"]  # fixtures for every folder

ROOT = Path(__file__).parents[1]
SHARED_DATA = ROOT.parent / "shared" / "data"

LONG = ("browser", "device", "server", "slow")
"""Markers of tests that take seconds."""

# No deadline: a busy machine is no failure. The ordinary run repeats its examples; `make soak` looks for new ones.
settings.register_profile("kalscope", max_examples=EXAMPLES, deadline=None, derandomize=FUZZ == 1)
settings.load_profile("kalscope")


def pytest_configure() -> None:
    """Restore SIGINT, which a shell ignores in background jobs: every program that a test starts inherits it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs a browser, a simulated board, a server or another process, and begin with it.

    These take the longest; the short ones then keep every worker busy to the end.
    """
    for item in items:
        mark(item)
    items.sort(key=lambda item: all(item.get_closest_marker(name) is None for name in LONG))


@pytest.fixture(scope="session", autouse=True)
def one_command_line() -> Iterator[None]:
    """Build the commands once a worker; typer builds them again at each run in its process, which takes 15 ms."""
    build = typer.main.get_command
    built = cache(lambda app, _commands: build(app))  # the dashboard adds a command of its own when it is imported
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", lambda app: built(app, len(app.registered_commands)))
        yield


@pytest.fixture(scope="session")
def nile():
    """The Nile flows at Aswan 1871-1970, 1e8 m³, shape (100,)."""
    return np.loadtxt(
        (line for line in (ROOT / "sample_data" / "nile.csv").read_text().splitlines() if line[:1].isdigit()),
        delimiter=",",
    )[:, 1]
