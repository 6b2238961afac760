"""Where branch coverage is measured: in tests that may still reach something new, and in nothing else.

coverage.py makes all Python in its process half as slow again: the collection of tests, pytest and libraries too.
So one worker imports everything of ours under measurement, the others do not measure their imports, and the cases
of a test are measured until one of them reaches nothing that its worker had not reached before.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
from coverage import Coverage
from each import AFTER_A_CASE

import kalscope
import kalscope_app

LIBRARIES = "numba", "scipy.signal", "scipy.stats", "matplotlib.pyplot", "viser", "distributed", "pyarrow.parquet"
"""What our modules import and takes long to; tests import it anyway."""


def trace(config: pytest.Config) -> None:
    """Begin to measure as this module says, where pytest-cov is asked to."""
    controller = getattr(config.pluginmanager.get_plugin("_cov"), "cov_controller", None)
    if controller is None:
        return
    controller.cov.stop()
    while (started_with_the_process := Coverage.current()) is not None:  # by coverage's own start, as in any child
        started_with_the_process.stop()
    if config.getoption("numprocesses", None) is None or hasattr(config, "workerinput"):
        traced = Traced(controller.cov)
        AFTER_A_CASE.append(traced.after_a_case)
        config.pluginmanager.register(traced)
        if getattr(config, "workerinput", {}).get("workerid", "gw0") == "gw0":
            traced.import_all()


class Traced:
    """The plugin that starts and stops the measurement, beside pytest-cov, which reports it."""

    def __init__(self, coverage: Coverage) -> None:
        self.coverage = coverage
        self.spent: set[tuple[str, str]] = set()
        """Tests of which a case reached nothing new."""
        self.seen = 0
        """Branches that were taken before the present case."""

    def import_all(self) -> None:
        """Measure the import of each of our modules."""
        for name in LIBRARIES:
            with suppress(ImportError):
                importlib.import_module(name)
        with self.coverage.collect():
            for package in (kalscope, kalscope_app):
                for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
                    with suppress(ImportError):  # a library is not installed
                        importlib.import_module(module.name)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        """Measure the fixtures of a test."""
        with self.measured(item):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """Measure a test."""
        before = self.seen = self.reached()
        with self.measured(item):
            result = yield
        if self.reached() == before:
            self.spent.add(function_of(item))
        return result

    def after_a_case(self) -> None:
        """Measure no more of a test that runs its cases itself, once one of them reached nothing new."""
        before, self.seen = self.seen, self.reached()
        if self.seen == before:
            self.coverage.stop()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Iterator[None]:
        """Measure how its fixtures end."""
        with self.measured(item):
            return (yield)

    @contextmanager
    def measured(self, item: pytest.Item) -> Iterator[None]:
        if item.get_closest_marker("untraced") or function_of(item) in self.spent:
            yield
        else:
            with self.coverage.collect():
                yield

    def reached(self) -> int:
        """How many branches were taken so far."""
        return sum(map(len, list(self.coverage._collector.data.values())))  # threads of a test may go on


def function_of(item: pytest.Item) -> tuple[str, str]:
    return str(item.path), getattr(item, "originalname", item.name)
