"""What the user of `kalscope tune` asks for and knows, as options, and what a tuning file already holds."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from kalscope.cli.options import (
    SensorNumbers,
    number_option,
    number_or,
    number_or_each,
    percentage,
    positive,
    text_option,
)
from kalscope.errors import BadFile, BadSetting
from kalscope.recording import Recording

if TYPE_CHECKING:
    from kalscope.estimation.request import Request
    from kalscope.tuning.tuning import ChannelTuning, Tuning


# What the user of `kalscope tune` asks for and knows, as options, and in the words of `find_parameters`.


FOR_LAMBDA = ("--lag-ms", "--cutoff-hz", "--noise-reduction-db", "--gain", "--ratio")
FOR_NOISE = ("--still", "--sigma", "--density", "--r")
SPECIFICATIONS = {
    "--lag-ms": ("lag_s", 1e-3),
    "--cutoff-hz": ("cutoff_hz", 1.0),
    "--noise-reduction-db": ("noise_reduction_db", 1.0),
    "--gain": ("gain", 1.0),
}
"""The options that specify the filter: the word of `find_parameters`, and its value over that of the option."""


@dataclass(frozen=True)
class TuneOptions:
    """The options that were given, without contradictions."""

    method: str = "ml"
    """Method of `estimate`."""
    numbers: dict[str, float] = field(default_factory=dict[str, float])
    """Those with a number, by name."""
    each: dict[str, dict[str, float]] = field(default_factory=dict[str, dict[str, float]])
    """Those with a number for each of several fused sensors, by name."""
    still: str | None = None
    """"FROM:TO" of a still stretch, or "auto": the one that the record shows."""
    momentum: float | Literal["auto"] = "auto"
    """τ in sample periods, or "auto"."""
    gate: float | None = None
    """Outlier gate on v²/s; NaN = off, None = as it is found."""
    robust: bool | Literal["auto"] = "auto"
    """Whether spikes are set aside; "auto" = where there are any."""
    fuse: str | None = None
    """The channels to fuse; None = channels are tuned one by one."""
    reference: str | None = None
    """The fused sensor whose offset is 0 and whose gain is 1; None = what all share is unknown."""
    gains: bool = False
    """Whether the gain of each fused sensor is estimated too."""

    def refuse_others(self, channel: str | None, every: bool) -> None:
        """Raise BadSetting for an option that --fuse excludes, or that needs --fuse where it is not given."""
        if self.fuse is None:
            for option, given in (("--reference", self.reference is not None), ("--sensor-gains", self.gains)):
                if given:
                    raise BadSetting(f"{option} needs --fuse, the sensors of one quantity (got none)")
        elif channel is not None or every:
            got = "--all" if every else f"--channel {channel!r}"
            raise BadSetting(f"--fuse must be used without --channel and --all: it names its channels (got {got})")

    def request(self, recording: Recording) -> Request:
        """The same in the words of `find_parameters`.

        Raises:
            BadSetting: a specification in s or Hz without a sample period, or a still stretch outside.
        """
        from kalscope.estimation.request import Noise, Request

        given = self.numbers
        for name, numbers in self.each.items():
            raise BadSetting(f"{name} must be one number without --fuse (got one for {', '.join(numbers)})")
        specified = [name for name in SPECIFICATIONS if name in given]
        for name in specified:
            if name in ("--lag-ms", "--cutoff-hz") and recording.sample_period is None:
                raise BadSetting(f"{name} needs the time between two samples: give --sample-period (got none)")
        noise = Noise(
            r=given.get("--r"),
            sigma=given.get("--sigma"),
            density=given.get("--density"),
            bandwidth_hz=given.get("--bandwidth-hz"),
            still=None if self.still is None else still_samples(recording, self.still),
        )
        return Request(
            method=self.method,
            target={SPECIFICATIONS[name][0]: given[name] * SPECIFICATIONS[name][1] for name in specified},
            ratio=given.get("--ratio"),
            noise=noise,
            momentum=self.momentum,
            overshoot=given.get("--overshoot"),
            robust=self.robust,
        )


NOTHING = TuneOptions()
NO_FUSION: dict[str, Any] = {}


Method = Annotated[str | None, typer.Option(metavar="NAME", help="ml (default), moments, als or allan.")]
LagMs = Annotated[float | None, number_option("Target: largest lag behind a ramp, ms.")]
CutoffHz = Annotated[float | None, number_option("Target: −3 dB frequency, Hz.")]
NoiseReductionDb = Annotated[float | None, number_option("Target: reduction of white noise, dB.")]
Gain = Annotated[float | None, number_option("Target: steady gain, 0 to 1.")]
Overshoot = Annotated[
    float | None,
    number_option("With one of these: allowed overshoot of a step, percent; sets momentum.", percentage),
]
Ratio = Annotated[float | None, number_option("Target: q/r, such as 0.01; r is estimated.")]
Still = Annotated[
    str | None,
    typer.Option(
        metavar="FROM:TO",
        help='When the input is constant, s (sample numbers without time), or "auto": gives r.',
    ),
]
Sigma = Annotated[
    SensorNumbers | None,
    number_option(
        "Data sheet: RMS noise, unit; gives r. For fused sensors, one each: a=2,b=3.", number_or_each(positive)
    ),
]
Density = Annotated[float | None, number_option("Data sheet: noise density, unit/√Hz; gives r.")]
BandwidthHz = Annotated[float | None, number_option("Noise bandwidth for --density, Hz.")]
R = Annotated[
    SensorNumbers | None,
    number_option(
        "Known measurement-noise variance, unit²; q is estimated. For fused sensors, one each: a=4,b=9.",
        number_or_each(positive),
    ),
]
Momentum = Annotated[
    float | None,
    number_option(
        'How long the signal keeps its direction, sample periods, or "auto" (default).', number_or("auto")
    ),
]
Gate = Annotated[
    float | None,
    number_option('Outlier gate on v²/s, such as 16, or "off"; default: as estimated.', number_or("off")),
]
Robust = Annotated[
    bool | None,
    typer.Option(
        "--robust/--no-robust",
        help="Always or never set spikes aside before the fit; default: where there are any.",
    ),
]


def tune_options(
    method: Method = None,
    lag_ms: LagMs = None,
    cutoff_hz: CutoffHz = None,
    noise_reduction_db: NoiseReductionDb = None,
    gain: Gain = None,
    overshoot: Overshoot = None,
    ratio: Ratio = None,
    still: Still = None,
    sigma: Sigma = None,
    density: Density = None,
    bandwidth_hz: BandwidthHz = None,
    r: R = None,
    momentum: Momentum = None,
    gate: Gate = None,
    robust: Robust = None,
) -> TuneOptions:
    """The options in place of the parameter `asked` of the command; see `with_options`.

    Raises:
        BadSetting: two of them contradict each other.
    """
    lambdas = zip(FOR_LAMBDA, (lag_ms, cutoff_hz, noise_reduction_db, gain, ratio), strict=True)
    noises = {name: one.each for name, one in (("--sigma", sigma), ("--r", r)) if one is not None}
    each = {name: value for name, value in noises.items() if isinstance(value, dict)}
    whole = ((name, value) for name, value in noises.items() if isinstance(value, float))
    others = (("--overshoot", overshoot), ("--density", density), ("--bandwidth-hz", bandwidth_hz))
    given = {name: value for name, value in (*lambdas, *whole, *others) if value is not None}
    _refuse_contradictions([*given, *each, *([] if still is None else ["--still"])], method)
    tau = "auto" if momentum is None or math.isnan(momentum) else momentum
    return TuneOptions(method or "ml", given, each, still, tau, gate, "auto" if robust is None else robust)


def fusion_options(
    fuse: Annotated[
        str | None, text_option("NAMES", "Fuse these channels, sensors of one quantity: a,b,c or 1,2,3.")
    ] = None,
    reference: Annotated[
        str | None, text_option("NAME", "With --fuse: the sensor without an offset; default: offsets add up to 0.")
    ] = None,
    sensor_gains: Annotated[
        bool, typer.Option("--sensor-gains", help="With --fuse: estimate the gain of each sensor too.")
    ] = False,
) -> dict[str, Any]:
    """Fields of TuneOptions, which a fleet does not have; see `with_options`."""
    return {"fuse": fuse, "reference": reference, "gains": sensor_gains}


def _refuse_contradictions(named: list[str], method: str | None) -> None:
    for group, must in ((FOR_LAMBDA, "decide q/r"), (FOR_NOISE, "give r")):
        several = [name for name in group if name in named]
        if len(several) > 1:
            raise BadSetting(f"only one of {', '.join(group)} can {must} (got {' and '.join(several)})")
    if "--overshoot" in named and not any(name in named for name in SPECIFICATIONS):
        raise BadSetting(f"--overshoot needs one of {', '.join(SPECIFICATIONS)} (got none)")
    if ("--density" in named) != ("--bandwidth-hz" in named):
        alone = "--density" if "--density" in named else "--bandwidth-hz"
        raise BadSetting(f"--density and --bandwidth-hz must be given together (got only {alone})")
    deciding = [name for name in (*FOR_LAMBDA, *FOR_NOISE) if name in named]
    if method not in (None, "ml") and deciding:
        raise BadSetting(f"--method {method} must be used without {deciding[0]}, which decides instead (got both)")


def still_samples(recording: Recording, text: str) -> tuple[int, int] | Literal["auto"]:
    """The samples of "FROM:TO" in s of the recording's time, both ends included: the first, and one past the last.

    "auto" stays: each channel has a still stretch of its own.

    Raises:
        BadSetting: not two ascending numbers, no sample between them, or time steps back between them.
    """
    if text == "auto":
        return "auto"
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        first, last = math.nan, math.nan
    if not first < last:
        raise BadSetting(f"--still must be FROM:TO, two ascending numbers such as 2:5.5, or auto (got {text!r})")
    inside = ((recording.time >= first) & (recording.time <= last)).nonzero()[0]
    unit = " s" if recording.sample_period is not None else ""
    if len(inside) == 0:
        low, high = float(recording.time.min()), float(recording.time.max())
        raise BadSetting(f"--still must lie in the recording, {low:.12g}:{high:.12g}{unit} (got {text!r})")
    start, stop = int(inside[0]), int(inside[-1]) + 1
    if stop - start > len(inside):
        raise BadSetting(f"--still must be one stretch, but time steps back in it (got {text!r})")
    return start, stop


# What a tuning file already holds and keeps when `kalscope tune -o` saves to it.


def _saved_before(recording: Recording, output: Path) -> Tuning | None:
    """The tuning in the file where it is one of this recording, at its sample period."""
    try:
        from kalscope.tuning.file import load_tuning

        before = load_tuning(output) if output.is_file() else None
    except BadFile:
        return None  # save_tuning reports what is wrong with it
    if before is None or before.sha256 != recording.sha256 or before.sample_period != recording.sample_period:
        return None
    return before


def _kept_channels(recording: Recording, tuned: Set[str], before: Tuning | None) -> list[ChannelTuning]:
    """The other channels that it holds: they were tuned before."""
    channels = () if before is None else before.channels
    return [one for one in channels if one.name in recording.names and one.name not in tuned]


def _replaced_chains(tuned: Set[str], before: Tuning | None) -> list[str]:
    """A sentence for each chain of filters that it held for a channel whose q and r were found now."""
    channels = () if before is None else before.channels
    return [
        f"{one.name}: {one.chain.words} is replaced by the Kalman filter of q and r"
        for one in channels
        if one.chain is not None and one.name in tuned
    ]


def save(
    recording: Recording,
    found: Sequence[ChannelTuning],
    tuned: Set[str],
    output: Path,
    fusion: ChannelTuning | None = None,
) -> list[str]:
    """Save filters beside those that the file keeps; returns notes about it for the user.

    Args:
        recording: where the channels are.
        found: the filters, at least one.
        tuned: all channels that were tuned, those without a filter too.
        output: the file.
        fusion: the filter that fuses them; None = the one that the file has.
    """
    before = _saved_before(recording, output)
    kept = _kept_channels(recording, tuned, before)
    notes = _replaced_chains({one.name for one in found}, before) if fusion is None else []
    if kept:
        notes.append(f"kept as they were in the tuning: {', '.join(one.name for one in kept)}")
    channels = sorted([*kept, *found], key=lambda one: recording.names.index(one.name))
    fusion = fusion or (None if before is None else before.fusion)
    from kalscope.tuning.file import save_tuning
    from kalscope.tuning.tuning import Tuning

    save_tuning(Tuning.of(recording, channels, selected=found[0].name, fusion=fusion), output)
    return notes
