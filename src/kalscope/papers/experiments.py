"""The three source documents: what opens as an experiment, and the filters they bring along.

`kalscope reproduce` draws all their figures and tables (`reproduction`); the dashboard offers each as
"experiment:NAME".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.errors import BadSetting
from kalscope.filtering.batch import FilterResult, kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.streaming import KalmanFilter
from kalscope.papers.generalized_filter import (
    GeneralizedFilter,
    generalized_filter,
)
from kalscope.papers.interactive_matter_2009 import document as lis302dl
from kalscope.papers.khan import paper as generalized
from kalscope.papers.maarif_2019 import paper as noise_reducer

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from kalscope.papers.parts import Experiment, Settings
    from kalscope.recording import Recording

PREFIX = "experiment:"
"""What stands before a name where sources are named."""


def list_experiments() -> list[Experiment]:
    """All experiments: name, title, paper, figure and one line each; in the order of the documents."""
    return [*noise_reducer.EXPERIMENTS, *generalized.EXPERIMENTS, *lis302dl.EXPERIMENTS]


def open_experiment(name: str) -> tuple[Recording, dict[str, Settings]]:
    """Open an experiment: its recording, and the settings of each channel by name.

    Args:
        name: a name of `list_experiments`, with or without "experiment:" before it.

    Returns:
        (recording, settings): settings are FilterParams, or GeneralizedParams where the document has a filter
        of its own; `run_filter` and `streaming_filter` take either. The recording's `source` reopens it.

    Raises:
        BadSetting: no such experiment.
    """
    bare = name.removeprefix(PREFIX)
    known = {experiment.name: experiment for experiment in list_experiments()}
    if bare not in known:
        raise BadSetting(f"experiment must be one of {', '.join(known)} (got {bare!r})")
    return known[bare].load()


def run_filter(z: ArrayLike, settings: Settings, dt: ArrayLike | None = None) -> FilterResult:
    """Filter a record with whatever filter the settings belong to; arguments and errors as `kalman_filter`."""
    if isinstance(settings, FilterParams):
        return kalman_filter(z, settings, dt)
    return generalized_filter(z, settings, dt)


def streaming_filter(settings: Settings) -> KalmanFilter | GeneralizedFilter:
    """The streaming filter of the settings; both have `update`, `x`, `p` and `k`."""
    return KalmanFilter(settings) if isinstance(settings, FilterParams) else GeneralizedFilter(settings)
