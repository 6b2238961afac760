"""What every export says about itself, in the same words: lines of harmless ASCII without comment marks."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from string import Template

from kalscope.export.board.chain import runs_kalman
from kalscope.export.job import ExportJob, FusionJob, Origin
from kalscope.export.names import comment_text, number_text
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.classic.stages import PowerOfTwo
from kalscope.filtering.kernels import GATE_LIMIT
from kalscope.filtering.steady_state import SteadyState
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import ChannelTuning

TEMPLATES = Path(__file__).parent / "targets" / "templates"


_MARKED = re.compile(r"^@(\w+) ?(.*\n)", re.MULTILINE)
_SECTION = re.compile(r"^=== (\w+)\n", re.MULTILINE)


def fill_template(name: str, marks: frozenset[str] = frozenset(), /, **texts: str) -> str:
    """A file of `targets/templates` in which each $name is replaced by its text.

    A line after `@momentum` or another mark of `Origin.marks` appears only in an export with that mark.
    """
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    chosen = _MARKED.sub(lambda found: found[2] if found[1] in marks else "", text)
    return Template(chosen).substitute(texts)


def fill_sections(name: str, marks: frozenset[str] = frozenset(), /, **texts: str) -> dict[str, str]:
    """The pieces of such a file that several places of an export use, by what follows `===` above each."""
    _, *pieces = _SECTION.split(fill_template(name, marks, **texts))
    return dict(zip(pieces[::2], pieces[1::2], strict=True))


def about(job: Origin, *, for_one_period: bool = False) -> tuple[str, ...]:
    """Where the export comes from and which sample period it holds for: only for that one, or with another q.

    Not for the first two lines of a Python file: a name may read "coding: utf-7".
    """
    one_period = for_one_period or job.for_one_period
    lines = [f"{job.title}, tuned and exported by Kalscope."]
    origin = [f"recording {comment_text(job.source_name)}"] if job.source_name else []
    if job.sha256:
        origin.append(f"SHA-256 {comment_text(job.sha256, 64)[:16]}")
    made = " ".join(comment_text(part, 40) for part in (job.tool, job.date) if part)
    if origin:
        lines.append(f"Tuned on {', '.join(origin)}.")
    if made:
        lines.append(f"Made by {made}.")
    if job.sample_period is None:
        lines.append("The sample period was not known; q holds for the sample rate of the recording only.")
    else:
        period = job.sample_period
        lines.append(f"Holds for a sample period of {number_text(period)} s ({1.0 / period:.4g} samples a second);")
        lines.append(
            "for another period export again: the constants below hold for this one only."
            if one_period
            else "with another period T multiply q by T / this period; r and p0 stay."
        )
    if one_period:
        lines.append("Each update counts as one such period: pass a missing sample as NaN, so that time advances.")
    return tuple(lines)


def about_channel(job: ExportJob, channel: ChannelTuning) -> tuple[str, ...]:
    """What the filter of one channel is: the three variances with their unit, gain, lag and start; or its chain."""
    if not runs_kalman(channel):
        return _about_classic(job, channel)
    square = ascii_squared(channel.unit) or "the square of the signal's unit"
    steady = job.steady(channel)
    gate = "off"
    if channel.gate is not None:
        limit = number_text(channel.gate)
        gate = f"a sample whose v^2/s exceeds {limit} is not used, {GATE_LIMIT} in a row at most"
    lines = [
        f"Channel {comment_text(channel.name)}; all are variances (not standard deviations) in {square}:",
        f"  process noise q = {number_text(channel.q)} per sample",
        f"  measurement noise r = {number_text(channel.r)}",
        f"  start variance p0 = {number_text(channel.p0, 'unknown (diffuse)')}",
        f"  start: {start_words(channel)}",
        f"  outlier gate: {gate}",
        f"  found: {comment_text(channel.how)}",
        f"  settled: gain K = {steady.gain:.6g}, lag behind a ramp {_lag_words(steady)}",
    ]
    if channel.chain is not None:
        lines[0] = f"Channel {comment_text(channel.name)}: {chain_words(channel.chain)}; variances in {square}:"
        lines[-1] += ", and that of the median"
    if channel.momentum > 0.0:
        lines[3:3] = [_momentum_words(job, channel)]
        lines.append(
            f"  settled: velocity gain L = {steady.velocity_gain:.6g} per sample,"
            f" overshoot on a step {100.0 * steady.overshoot:.3g} %"
        )
    return tuple(lines)


def _about_classic(job: ExportJob, channel: ChannelTuning) -> tuple[str, ...]:
    """What a classic filter is, and its lag where that does not depend on the signal."""
    chain = channel.chain
    lines = [f"Channel {comment_text(channel.name)}, in {comment_text(channel.unit, 20) or 'its own unit'}:"]
    if chain is None or chain.then is None:
        return tuple(lines)
    lines.append(f"  {chain_words(chain)}; a missing sample holds the value")
    if isinstance(chain.then, PowerOfTwo):
        lines.append("  computed in floats, where a product with a power of two is exact: no bits are shifted")
    lag = chain.then.lag
    if lag is not None and chain.median == 1:
        seconds = "" if job.sample_period is None else f" = {lag * job.sample_period:.4g} s"
        lines.append(f"  settled: lag behind a ramp {lag:.4g} samples{seconds}")
    return tuple(lines)


def chain_words(chain: Chain) -> str:
    """A chain in ASCII: median of 5, then one-euro (cut-off 0.02, beta 0.1)."""
    return comment_text(chain.words.replace("α", "alpha").replace("β", "beta"), 100)


def about_fusion(job: FusionJob) -> tuple[str, ...]:
    """What the fused filter is: variances with their unit, each sensor, and gain and lag while all answer."""
    fusion, steady = job.fusion, job.steady
    square = ascii_squared(fusion.unit) or "the square of its unit"
    start = "the first reading sets x = (z - offset) / gain and p = r / gain^2"
    gate = "off"
    if fusion.gate is not None:
        limit = number_text(fusion.gate)
        gate = f"a reading whose v^2/s exceeds {limit} is not used, {GATE_LIMIT} in a row of a sensor at most"
    lines = [
        f"Fused value {comment_text(fusion.name)}; all are variances (not standard deviations),"
        f" q and p0 in {square}:",
        f"  process noise q = {number_text(fusion.q)} per sample",
        *([_momentum_words(job, fusion)] if job.has_momentum else []),
        f"  start variance p0 = {number_text(fusion.p0, 'unknown (diffuse)')}",
        f"  start: {start if fusion.p0 is None else start_words(fusion)}",
        f"  outlier gate: {gate}",
        f"  found: {comment_text(fusion.how)}",
        f"  settled, while all sensors answer: gain K = {steady.gain:.6g}, lag behind a ramp {_lag_words(steady)}",
        "Sensors, in the order of the readings: each reads offset + gain x + noise of variance r, in its own unit.",
    ]
    values = zip(fusion.sensors, fusion.offset, fusion.gain, fusion.r, fusion.params.shares, strict=True)
    for i, (name, offset, gain, r, share) in enumerate(values, 1):
        lines.append(
            f"  {i} {comment_text(name, 40)}: offset {number_text(offset)}, gain {number_text(gain)},"
            f" r = {number_text(r)}, share {100.0 * share:.3g} %"
        )
    return tuple(lines)


def _lag_words(steady: SteadyState) -> str:
    seconds = "" if steady.lag_s is None else f" = {steady.lag_s:.4g} s"
    return f"{steady.lag_samples:.4g} samples{seconds}"


def _momentum_words(job: Origin, one: ChannelTuning | FusionTuning) -> str:
    lasts = f"{number_text(one.momentum)} samples"
    if job.sample_period is not None:
        lasts += f" = {one.momentum * job.sample_period:.4g} s"
    return f"  momentum tau = {lasts}: how long the signal keeps its direction"


def ascii_squared(unit: str) -> str:
    """The unit of a variance: counts^2, (m/s)^2; "" where the unit is not known."""
    word = comment_text(unit, 20)
    if not word:
        return ""
    return f"{word}^2" if word.isalpha() else f"({word})^2"


def start_words(channel: ChannelTuning | FusionTuning) -> str:
    """The start rule in a phrase."""
    if channel.p0 is None:
        return "the first sample sets x = z and p = r"
    if channel.x0 is None:
        return "the first sample sets x = z; p continues from p0"
    return f"x0 = {number_text(channel.x0)} before the first predict"


def commented(lines: Iterable[str], mark: str) -> str:
    """The lines as comments, each after `mark`; ends with a line end."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)
