"""What an export starts from: one checked value that every target reads, and the header texts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from string import Template

from kalscope.errors import BadSetting
from kalscope.export.float32 import runs_kalman
from kalscope.export.names import comment_text, identifiers, number_text
from kalscope.filtering.classic import Chain
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.steady import SteadyState, steady_state, step_constants
from kalscope.tuning.tuning import ChannelTuning, Tuning

# What an export starts from: one checked value that every target reads.


@dataclass(frozen=True)
class ExportJob:
    """The filters to be exported and where they come from.

    The texts are from outside: use them only through `comment_text`.

    Raises:
        BadSetting: No channel.
    """

    channels: tuple[ChannelTuning, ...]
    """The filters, at least one, names distinct (as in the tuning); or one alone that fuses sensors."""
    sample_period: float | None = None
    """Sample period that q belongs to, s; None where unknown."""
    source_name: str = ""
    """Name of the recording it was tuned on, for display."""
    sha256: str = ""
    """SHA-256 of that recording, "" where unknown."""
    tool: str = ""
    """Program and version that made the tuning."""
    date: str = ""
    """When the tuning was made, UTC, ISO 8601."""

    def __post_init__(self) -> None:
        if not self.channels:
            raise BadSetting("an export must hold at least one channel (got none)")

    @property
    def fusion(self) -> ChannelTuning:
        """The filter of an export that fuses."""
        return self.channels[0]

    @property
    def fuses(self) -> bool:
        """Whether the filter is one that fuses sensors."""
        return bool(self.fusion.sensors)

    @property
    def identifiers(self) -> tuple[str, ...]:
        """A distinct identifier [a-z][a-z0-9_]* for each channel in order, or each sensor and the fused value."""
        return identifiers(name for one in self.channels for name in (*one.sensors, one.name))

    @property
    def named_channels(self) -> tuple[tuple[str, ChannelTuning], ...]:
        """Each channel with its identifier, in their order; or the fused value with its own."""
        return tuple(zip(self.identifiers[-len(self.channels) :], self.channels, strict=True))

    @property
    def sensor_identifiers(self) -> tuple[str, ...]:
        """A distinct identifier for each sensor, in their order."""
        return self.identifiers[:-1]

    @property
    def has_momentum(self) -> bool:
        """Whether any filter has momentum: its code then has the second state, also for those without."""
        return any(channel.momentum > 0.0 and runs_kalman(channel) for channel in self.channels)

    @property
    def has_chain(self) -> bool:
        """Whether any filter is a chain."""
        return any(channel.chain is not None for channel in self.channels)

    @property
    def has_two_speeds(self) -> bool:
        """Whether any filter has two speeds."""
        return any(channel.fast is not None for channel in self.channels)

    @property
    def has_kinds(self) -> bool:
        """Whether each channel says which filter it has: one may be another than the Kalman filter alone."""
        return self.has_chain or self.has_two_speeds

    @property
    def has_median(self) -> bool:
        """Whether the median of samples goes into any filter."""
        return any(channel.chain is not None and channel.chain.median > 1 for channel in self.channels)

    @property
    def has_kalman(self) -> bool:
        """Whether any channel has a Kalman filter, after a median or alone."""
        return any(map(runs_kalman, self.channels))

    @property
    def marks(self) -> frozenset[str]:
        """Marks of the lines of a template that this export needs."""
        has = {
            "momentum": self.has_momentum,
            "plain": self.has_kalman and not self.has_momentum,
            "chain": self.has_kinds,
            "two_speeds": self.has_two_speeds,
            "median": self.has_median,
            "notch": any(
                channel.chain is not None and channel.chain.notch is not None for channel in self.channels
            ),
            "kalman": self.has_kalman,
            "classic": not self.has_kalman,
            "gains": self.fusion.has_gains,
        }
        return frozenset(name for name, it_has in has.items() if it_has)

    @property
    def sensor_values(self) -> dict[str, tuple[float, ...]]:
        """Offset and gain of each sensor of a fusion, and its noise variance on the scale of x, r / gain²."""
        fusion = self.fusion
        return {"r": tuple(fusion.params.scaled_r.tolist()), "offset": fusion.offset, "gain": fusion.gain}

    def steady(self, channel: ChannelTuning) -> SteadyState:
        """Gain, lag and cut-off of the settled filter of one of the channels; while all of its sensors answer."""
        return steady_state(channel.params, self.sample_period)


def step_of(channel: ChannelTuning) -> dict[str, float]:
    """The constants of a filter with momentum by the names of `StepConstants`; {} without momentum."""
    return asdict(step_constants(channel.q, channel.momentum)) if channel.momentum > 0.0 else {}


def start_of(one: ChannelTuning) -> dict[str, float | None]:
    """q, r of one sensor, and how the filter starts; None = automatic, or a gate that is off.

    Of two speeds also the factor of q and the probability of a spike, in place of the gate.
    """
    names = ("q", "p0", "x0", "gate") if one.sensors else ("q", "r", "p0", "x0", "gate")
    names = names if one.fast is None else ("q", "r", "p0", "x0", "fast", "spikes")
    return {name: getattr(one, name) for name in names}


def job_of(tuning: Tuning) -> ExportJob:
    """The job of the fusion of a tuning, or of all channels where it has none."""
    origin = {one.name: getattr(tuning, one.name) for one in fields(ExportJob) if one.name != "channels"}
    return ExportJob(tuning.channels if tuning.fusion is None else (tuning.fusion,), **origin)


# What every export says about itself, in the same words: lines of harmless ASCII without comment marks.


TEMPLATES = Path(__file__).parent / "targets" / "templates"


_MARKED = re.compile(r"^@(\w+) ?(.*\n)", re.MULTILINE)
_SECTION = re.compile(r"^=== (\w+)\n", re.MULTILINE)


def fill_template(name: str, marks: frozenset[str] = frozenset(), /, **texts: str) -> str:
    """A file of `targets/templates` in which each $name is replaced by its text.

    A line after `@momentum` or another mark of `ExportJob.marks` appears only in an export with that mark.
    """
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    chosen = _MARKED.sub(lambda line: line[2] if line[1] in marks else "", text)
    return Template(chosen).substitute(texts)


def fill_sections(name: str, marks: frozenset[str] = frozenset(), /, **texts: str) -> dict[str, str]:
    """The pieces of such a file that several places of an export use, by what follows `===` above each."""
    _, *pieces = _SECTION.split(fill_template(name, marks, **texts))
    return dict(zip(pieces[::2], pieces[1::2], strict=True))


def about(job: ExportJob) -> tuple[str, ...]:
    """Where the export comes from and which sample period it holds for: only for that one, or with another q.

    Not for the first two lines of a Python file: a name may read "coding: utf-7".
    """
    title = "Kalman filter of several sensors" if job.fuses else "Scalar Kalman noise filter"
    lines = [f"{'Noise filters' if job.has_kinds else title}, tuned and exported by Kalscope."]
    sha256 = f"SHA-256 {comment_text(job.sha256, 64)[:16]}" if job.sha256 else ""
    origin = [f"recording {comment_text(job.source_name)}" if job.source_name else "", sha256]
    if any(origin):
        lines.append(f"Tuned on {', '.join(filter(None, origin))}.")
    if job.tool or job.date:
        lines.append(f"Made by {comment_text(f'{job.tool} {job.date}', 80)}.")
    one_period = job.has_momentum or job.has_kinds  # no user can convert these
    if job.sample_period is None:
        lines.append("The sample period was not known; q holds for the sample rate of the recording only.")
    else:
        period = job.sample_period
        other = "export again" if one_period else "T multiply q by T / this period; r and p0 stay"
        lines.append(f"Holds for a sample period of {number_text(period)} s ({1.0 / period:.4g} samples a second);")
        lines.append(f"for another period {other}.")
    if one_period:
        lines.append("Each update counts as one such period: pass a missing sample as NaN, so that time advances.")
    return tuple(lines)


def about_channel(job: ExportJob, channel: ChannelTuning) -> tuple[str, ...]:
    """What one filter is: the variances with their unit, gain, lag and start, and its sensors; or its chain."""
    name, chain = comment_text(channel.name), channel.chain
    words = "" if chain is None else f", {chain_words(chain)}"
    if not runs_kalman(channel):
        unit = comment_text(channel.unit, 20) or "its own unit"
        return (f"Channel {name}, in {unit}{words}; a missing sample holds the value",)

    def time(samples: float) -> str:
        seconds = "" if job.sample_period is None else f" = {samples * job.sample_period:.4g} s"
        return f"{samples:.4g} samples{seconds}"

    steady, gate, sensors = job.steady(channel), "off", channel.sensors
    if channel.gate is not None:
        gate = f"v^2/s above {number_text(channel.gate)} is not used, {GATE_LIMIT} in a row at most"
    settled = f"gain K = {steady.gain:.6g}, lag behind a ramp {time(float(steady.lag_samples))}"
    if channel.momentum > 0.0 and not sensors:
        settled += f", velocity gain L = {steady.velocity_gain:.6g}, overshoot {100.0 * steady.overshoot:.3g} %"
    before = "" if chain is None else " and the ".join(stage.name.lower() for stage in chain.first)
    when = ", while all sensors answer" if sensors else f", without the {before}" if before else ""
    square = ascii_squared(channel.unit) or "the square of its unit"
    tau = f"  momentum tau = {time(channel.momentum)}: how long the signal keeps its direction"
    lines = (
        f"{'Fused value' if sensors else 'Channel'} {name}{words}: variances (not standard deviations) in {square}",
        f"  process noise q = {number_text(channel.q)} per sample",
        "" if sensors else f"  measurement noise r = {number_text(channel.r)}",
        tau if channel.momentum > 0.0 else "",
        "" if channel.fast is None else f"  two speeds: q grows {channel.fast:.6g} x while the signal moves",
        f"  start variance p0 = {number_text(channel.p0, 'unknown (diffuse)')}",
        f"  start: {_start_words(channel)}",
        f"  outlier gate: {gate}",
        f"  found: {comment_text(channel.how)}",
        f"  settled{when}: {settled}",
    )
    return (*filter(None, lines), *(_about_sensors(channel) if sensors else ()))


def _about_sensors(fusion: ChannelTuning) -> Iterator[str]:
    yield "Sensors, in the order of the readings: offset + gain x + noise of variance r, each in its own unit."
    values = zip(fusion.sensors, fusion.offset, fusion.gain, fusion.r, fusion.params.shares, strict=True)
    for i, (name, offset, gain, r, share) in enumerate(values, 1):
        yield (
            f"  {i} {comment_text(name, 40)}: offset {number_text(offset)}, gain {number_text(gain)},"
            f" r = {number_text(r)}, share {100.0 * share:.3g} %"
        )


def chain_words(chain: Chain) -> str:
    """A chain in ASCII: median of 5, then one-euro (cut-off 0.02, beta 0.1)."""
    return comment_text(chain.words.replace("α", "alpha").replace("β", "beta"), 100)


def ascii_squared(unit: str) -> str:
    """The unit of a variance: counts^2, (m/s)^2; "" where the unit is not known."""
    word = comment_text(unit, 20)
    if not word:
        return ""
    return f"{word}^2" if word.isalpha() else f"({word})^2"


def _start_words(channel: ChannelTuning) -> str:
    if channel.p0 is None:
        return "the first reading sets x = z and p = r"
    if channel.x0 is None:
        return "the first reading sets x = z; p continues from p0"
    return f"x0 = {number_text(channel.x0)} before the first predict"


def commented(lines: Iterable[str], mark: str) -> str:
    """The lines as comments, each after `mark`; ends with a line end."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)
