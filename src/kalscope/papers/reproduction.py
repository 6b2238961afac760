"""The three source documents: what opens as an experiment, and all chapters, checks and numbers in one go."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from typing import Any

from kalscope.common.progress import OnProgress, Progress
from kalscope.errors import BadSetting
from kalscope.filtering.filter import Filter, StandardFilter
from kalscope.filtering.params import FilterParams
from kalscope.papers import interactive_matter_2009, khan, maarif_2019
from kalscope.papers.document import Chapter, Check, Experiment, list_disagreements, page
from kalscope.recording import Recording

PREFIX = "experiment:"
"""Prefix of an experiment's name in a source."""


def list_experiments() -> list[Experiment]:
    """All experiments, in the order of the documents."""
    return [*maarif_2019.EXPERIMENTS, *khan.EXPERIMENTS, *interactive_matter_2009.EXPERIMENTS]


def open_experiment(name: str) -> tuple[Recording, dict[str, Filter]]:
    """Open an experiment: its recording, and the filter of each channel by name.

    Args:
        name: a name of `list_experiments`, with or without "experiment:" before it.

    Returns:
        (recording, filters): StandardFilter, or GeneralizedParams where the document has a filter of its own.
        The recording's `source` reopens it.

    Raises:
        BadSetting: no such experiment.
    """
    bare = name.removeprefix(PREFIX)
    known = {experiment.name: experiment for experiment in list_experiments()}
    if bare not in known:
        raise BadSetting(f"experiment must be one of {', '.join(known)} (got {bare!r})")
    recording, settings = known[bare].make()
    each = settings if isinstance(settings, tuple) else (settings,) * len(recording.names)
    filters: dict[str, Filter] = {
        name: StandardFilter(one) if isinstance(one, FilterParams) else one
        for name, one in zip(recording.names, each, strict=True)
    }
    return replace(recording, source=f"{PREFIX}{bare}", title=known[bare].title), filters


@dataclass(frozen=True)
class Reproduction:
    """What `kalscope reproduce` writes. The same at every run on the same machine."""

    chapters: tuple[Chapter, ...]
    """One per document."""
    html: str
    """The whole page, self-contained."""
    results: dict[str, Any]
    """The numbers, as JSON takes them: "checks", "disagreements", and the tables of each document by name."""

    @property
    def checks(self) -> tuple[Check, ...]:
        """The checks of all documents."""
        return tuple(check for chapter in self.chapters for check in chapter.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """Reproduced numbers that left their tolerance."""
        return tuple(check for check in self.checks if not check.passed)

    @property
    def json(self) -> str:
        """`results` as text, indented."""
        return json.dumps(self.results, indent=1, ensure_ascii=False, allow_nan=False, default=float) + "\n"


def reproduce(progress: OnProgress | None = None, cancelled: Callable[[], bool] | None = None) -> Reproduction:
    """Reproduce the documents' figures and tables.

    Args:
        progress: called with the fraction done, 0 … 1, and what is being done; None = not reported.
        cancelled: asked now and then whether to stop; None = never.

    Returns:
        The page, the numbers and the checks; numbers outside their tolerance are in `failed`, not raised.

    Raises:
        Cancelled: `cancelled()` was true.
    """
    whole = Progress(progress, cancelled)
    chapters = (
        maarif_2019.chapter(whole.part(0.0, 0.5)),
        khan.chapter(whole.part(0.5, 0.6)),
        interactive_matter_2009.chapter(whole.part(0.6, 1.0)),
    )
    checks = [{**asdict(check), "passed": check.passed} for chapter in chapters for check in chapter.checks]
    results: dict[str, Any] = {"kalscope": version("kalscope"), "passed": all(check["passed"] for check in checks)}
    results |= {one.key: {block.name: block.rows for block in one.blocks if block.rows} for one in chapters}
    results |= {"disagreements": list_disagreements(), "checks": checks}
    return Reproduction(chapters, page(chapters, results["kalscope"]), results)
