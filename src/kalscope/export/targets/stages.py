"""The filters of an export, piece by piece: the Kalman filter, and the classic ones, each only where it is used.

`templates/c/stages` has a file a filter, in C99 that C++ compiles as well: its numbers in the tuning, its state,
how to start it, and what it does with a sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from kalscope.export.float32 import runs_kalman
from kalscope.export.job import ExportJob, fill_sections, fill_template
from kalscope.filtering.classic import Butterworth, Exponential, Median, MovingAverage, OneEuro, PowerOfTwo, Stage
from kalscope.tuning.tuning import ChannelTuning

_PIECES: dict[type[Stage], tuple[str, tuple[str, ...]]] = {
    MovingAverage: ("moving_average", ("window",)),
    Exponential: ("exponential", ("alpha",)),
    PowerOfTwo: ("exponential", ("alpha",)),
    Median: ("median", ("window",)),
    Butterworth: ("butterworth", ("to_slope", "decay", "to_level")),
    OneEuro: ("one_euro", ("slowest", "growth", "of_speed")),
}
"""Each filter's piece of code, and the numbers of its tuning."""

KALMAN_FIELDS = ("q", "r", "p0", "x0", "gate", "settled_gain")
"""Numbers of a Kalman filter in the tuning."""
MOMENTUM_FIELDS = ("momentum", "e", "f", "q11", "q12", "q22", "w0")
"""The others of one with momentum."""
WHOLE = frozenset(("filter", "median", "window"))
"""Fields of a tuning that are whole numbers."""

_TUNING_CHANGES = "q, r and gate may be changed at any time"
_WITH_MOMENTUM_CHANGES = "r and gate may be changed at any time"
_CHAIN_CHANGES = "the numbers of this copy may be changed at any time, except median, filter and window"


@dataclass(frozen=True)
class Code:
    """Filters in C, in the parts that a header and a source are made of."""

    types: str
    """The tuning and the state."""
    functions: str
    """Start and update."""


def piece_of(channel: ChannelTuning) -> str:
    """The piece of code that is the last filter of a channel."""
    stage = None if channel.chain is None else channel.chain.then
    return "kalman" if stage is None else _PIECES[type(stage)][0]


def numbers_of(stage: Stage) -> dict[str, int | float]:
    """What a classic filter computes with, by the names that its code has for it."""
    if isinstance(stage, MovingAverage | Median):
        return {"window": stage.window}
    return dict(zip(_PIECES[type(stage)][1], stage.constants, strict=False))


def used_pieces(job: ExportJob) -> tuple[str, ...]:
    """The pieces of code that an export needs for its last filters, in a fixed order."""
    used = set(map(piece_of, job.channels))
    order = ("kalman", *dict.fromkeys(name for name, _ in _PIECES.values()))
    return tuple(name for name in order if name in used)


def code_in_c(job: ExportJob, linkage: str = "") -> Code:
    """The filters of an export.

    Args:
        job: the export.
        linkage: what precedes the two functions that a user calls: "static " in a header.
    """
    marks, windows = job.marks, {name: str(n) for name, n in windows_of(job).items()}
    if not job.has_chain:
        parts = [fill_sections("c/stages/kalman.c", marks, own="", update="kalscope_real kalscope_update")]
        changing = _WITH_MOMENTUM_CHANGES if job.has_momentum else _TUNING_CHANGES
    else:
        update = "static kalscope_real kalscope_kalman"
        texts = {"own": "kalscope_", "update": update, **windows}
        parts = [fill_sections(f"c/stages/{name}.c", marks, **texts) for name in _files(job)]
        changing = _CHAIN_CHANGES
    kinds = [f"KALSCOPE_{name.upper()}" for name in used_pieces(job)]
    types = fill_template(
        "c/types.h",
        marks,
        kinds=", ".join(kinds),
        tuning_fields=_merged(part.get("tuning", "") for part in parts),
        state_fields=_merged(part.get("state", "") for part in parts),
        changing=changing,
    )
    functions = fill_template(
        "c/functions.c",
        marks,
        linkage=linkage,
        starts=_merged(part.get("start", "") for part in parts),
        updates="".join(part.get("update", "") for part in parts).removesuffix("\n"),
        before="".join(part.get("before", "") for part in parts),
        cases="".join(
            f"    case {kind}: return kalscope_{name}(filter, z);\n"
            for kind, name in zip(kinds, used_pieces(job), strict=True)
        ),
    )
    return Code(types, functions)


def _files(job: ExportJob) -> tuple[str, ...]:
    used = used_pieces(job)
    first = ("first_median",) if job.has_median else ()
    middle = ("middle",) if job.has_median or "median" in used else ()
    return (*first, *middle, *used)


def windows_of(job: ExportJob) -> dict[str, int]:
    """How many samples each buffer of a channel holds: the longest window that any channel needs."""
    chains = [channel.chain for channel in job.channels if channel.chain is not None]
    last = [chain.then for chain in chains if isinstance(chain.then, MovingAverage | Median)]
    return {
        "first_window": max((chain.median for chain in chains), default=1),
        "window": max((stage.window for stage in last), default=1),
        "ordered": max((stage.window for stage in last if isinstance(stage, Median)), default=1),
    }


def _merged(pieces: Iterable[str]) -> str:
    """The lines of all pieces, each line once."""
    return "".join(dict.fromkeys(line for piece in pieces for line in piece.splitlines(keepends=True)))


def tuning_values(
    job: ExportJob, channel: ChannelTuning, kalman: Mapping[str, str], number: Callable[[float], str]
) -> dict[str, str]:
    """The fields of the tuning of a channel as texts; those that are left out are 0.

    Args:
        job: the export.
        channel: one of its channels.
        kalman: the numbers of its Kalman filter; {} where it has none.
        number: how the language writes a number that is not whole.
    """
    if not job.has_chain:
        return dict(kalman)
    chain, values = channel.chain, {"filter": f"KALSCOPE_{piece_of(channel).upper()}"}
    if job.has_median:
        values["median"] = str(1 if chain is None else chain.median)
    if runs_kalman(channel):
        return values | dict(kalman)
    if job.has_kalman:
        values["x0"] = "NAN"
    numbers = {} if chain is None or chain.then is None else numbers_of(chain.then)
    return values | {name: str(n) if isinstance(n, int) else number(n) for name, n in numbers.items()}


def tuning_fields(job: ExportJob) -> tuple[str, ...]:
    """All fields of a tuning in their order."""
    kalman = KALMAN_FIELDS + (MOMENTUM_FIELDS if job.has_momentum else ())
    if not job.has_chain:
        return kalman
    fields = dict(_PIECES.values()) | {"kalman": kalman}
    first = ("filter", "median") if job.has_median else ("filter",)
    return tuple(dict.fromkeys((*first, *(field for name in used_pieces(job) for field in fields[name]))))
