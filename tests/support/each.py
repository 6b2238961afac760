"""Many cases of one law in one test: a test of its own costs each case some milliseconds in every worker.

A failure shows every case that fails. Cases that take long stay tests of their own (`pytest.mark.parametrize`), and
those that a machine may lack something for: a skip here would end them all.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable

import pytest


def each(
    names: str | tuple[str, ...],
    cases: Iterable[object],
    ids: Iterable[str] | Callable[[object], object] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test with each case in turn, where `pytest.mark.parametrize` would make a test of each.

    Every case draws the same numbers from the generator of its module, and has a `tmp_path` of its own.
    """
    cases = list(cases)
    labels = [None] * len(cases) if ids is None else list(map(ids, cases) if callable(ids) else ids)
    values = [values_of(case, names) for case in cases]
    assert len(values) == len(labels) > 0

    def of_all(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def every(**fixtures: object) -> None:
            generator = inspect.unwrap(test).__globals__.get("RNG")
            state = generator and generator.bit_generator.state
            misses = list[BaseException]()
            for at, (label, case) in enumerate(zip(labels, values, strict=True)):
                given = {**fixtures, **case}
                if "tmp_path" in fixtures:
                    given["tmp_path"] = fixtures["tmp_path"] / f"case_{at}"
                    given["tmp_path"].mkdir()
                if generator is not None:
                    generator.bit_generator.state = state
                try:
                    test(**given)
                except (Exception, pytest.fail.Exception) as miss:
                    miss.add_note(f"in case {at} of {names}: {case if label is None else label!r}")
                    misses.append(miss)
            if misses:
                raise BaseExceptionGroup(f"{len(misses)} of {len(cases)} cases of {names}", misses)

        left = [one for one in inspect.signature(test).parameters.values() if one.name not in values[0]]
        every.__signature__ = inspect.Signature(left)
        return every

    return of_all


def values_of(case: object, names: str | tuple[str, ...]) -> dict[str, object]:
    """The arguments of a case by their names."""
    if hasattr(case, "marks"):  # a pytest.param
        assert not case.marks, "a marked case is a test of its own"
        case = case.values if isinstance(names, tuple) else case.values[0]
    return dict(zip(names, case, strict=True)) if isinstance(names, tuple) else {names: case}
