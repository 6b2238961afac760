"""The three source documents: what opens as an experiment, and the filters that come with it.

`kalscope reproduce` draws all their figures and tables (`reproduction`); the dashboard offers each as
"experiment:NAME".
"""

from __future__ import annotations

from dataclasses import replace

from kalscope.errors import BadSetting
from kalscope.filtering.params import FilterParams
from kalscope.filtering.protocol import Filter, StandardFilter
from kalscope.papers import interactive_matter_2009, khan, maarif_2019
from kalscope.papers.parts import Experiment
from kalscope.recording import Recording

PREFIX = "experiment:"
"""Prefix of an experiment's name in a source."""


def list_experiments() -> list[Experiment]:
    """All experiments: name, title, paper, figure and one line each; in the order of the documents."""
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
