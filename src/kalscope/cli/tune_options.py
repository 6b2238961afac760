"""What the user of `kalscope tune` wants and knows, as options, and what a tuning file already holds."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from kalscope.cli.options import number_option, number_or, number_or_each, percentage, positive, text_option
from kalscope.errors import BadFile, BadSetting
from kalscope.recording import Recording

if TYPE_CHECKING:
    from kalscope.estimation.request import Request
    from kalscope.tuning.tuning import ChannelTuning

SPECIFICATIONS = {
    "--lag-ms": ("lag_s", 1e-3),
    "--cutoff-hz": ("cutoff_hz", 1.0),
    "--noise-reduction-db": ("noise_reduction_db", 1.0),
    "--gain": ("gain", 1.0),
}
"""The options that specify the filter: the word of `find_parameters`, and its value over that of the option."""
FOR_LAMBDA = (*SPECIFICATIONS, "--ratio")
FOR_NOISE = ("--still", "--sigma", "--density", "--r")


@dataclass(frozen=True)
class TuneOptions:
    """The options of `kalscope tune` and `kalscope fleet`; see `with_options`.

    Raises:
        BadSetting: two of them contradict each other.
    """

    lag_ms: Annotated[float | None, number_option("Target: largest lag behind a ramp, ms.")] = None
    cutoff_hz: Annotated[float | None, number_option("Target: −3 dB frequency, Hz.")] = None
    noise_reduction_db: Annotated[float | None, number_option("Target: reduction of white noise, dB.")] = None
    gain: Annotated[float | None, number_option("Target: steady gain, 0 to 1.")] = None
    overshoot: Annotated[
        float | None,
        number_option("With one of these: allowed overshoot of a step, percent; sets momentum.", percentage),
    ] = None
    ratio: Annotated[float | None, number_option("Target: q/r, such as 0.01; r is estimated.")] = None
    still: Annotated[
        str | None,
        text_option("STRETCH", 'Where the input is constant: FROM:TO in s or sample numbers, or "auto"; gives r.'),
    ] = None
    sigma: Annotated[
        Any,
        number_option("Data sheet: RMS noise, unit; gives r.", number_or_each(positive)),
    ] = None
    """A number, or one for each of several fused sensors by its name."""
    density: Annotated[float | None, number_option("Data sheet: noise density, unit/√Hz; gives r.")] = None
    bandwidth_hz: Annotated[float | None, number_option("Noise bandwidth for --density, Hz.")] = None
    r: Annotated[
        Any,
        number_option("Known measurement-noise variance, unit²; q is estimated.", number_or_each(positive)),
    ] = None
    """As `sigma`."""
    momentum: Annotated[
        float | None,
        number_option(
            'How long the signal keeps its direction, sample periods, or "auto" (default).', number_or("auto")
        ),
    ] = None
    """In sample periods; NaN or None = it is estimated."""
    two_speeds: Annotated[
        bool, typer.Option("--two-speeds", help="Calm at rest, quick while it moves, where the record shows it.")
    ] = False
    gate: Annotated[
        float | None,
        number_option('Outlier gate on v²/s, such as 16, or "off"; default: as estimated.', number_or("off")),
    ] = None
    """NaN = off; None = as it is estimated."""
    robust: Annotated[
        bool | None,
        typer.Option(
            "--robust/--no-robust",
            help="Always or never set spikes aside before the fit; default: where there are any.",
        ),
    ] = None

    def _value(self, option: str) -> Any:
        return getattr(self, option.removeprefix("--").replace("-", "_"))

    def __post_init__(self) -> None:
        for group, must in ((FOR_LAMBDA, "decide q/r"), (FOR_NOISE, "give r")):
            several = [option for option in group if self._value(option) is not None]
            if len(several) > 1:
                raise BadSetting(f"only one of {', '.join(group)} can {must} (got {' and '.join(several)})")
        if (self.density is None) != (self.bandwidth_hz is None):
            alone = "--bandwidth-hz" if self.density is None else "--density"
            raise BadSetting(f"--density and --bandwidth-hz must be given together (got only {alone})")

    @property
    def sensor_noise(self) -> tuple[str, dict[str, float]] | None:
        """The option with a number for each of several sensors, and its numbers; None where none has."""
        noises: dict[str, dict[str, float] | float | None] = {"--sigma": self.sigma, "--r": self.r}
        return next(((option, one) for option, one in noises.items() if isinstance(one, dict)), None)

    def request(self, recording: Recording) -> Request:
        """The same in the words of `find_parameters`.

        Raises:
            BadSetting: a specification in s or Hz without a sample period, a still stretch outside, or a number
                for each of several sensors.
        """
        from kalscope.estimation.request import Noise, Request

        if self.sensor_noise is not None:
            option, each = self.sensor_noise
            raise BadSetting(f"{option} must be one number without --fuse (got one for {', '.join(each)})")
        specified = {option: self._value(option) for option in SPECIFICATIONS if self._value(option) is not None}
        for option in specified:
            if option in ("--lag-ms", "--cutoff-hz") and recording.sample_period is None:
                raise BadSetting(f"{option} needs the time between two samples: give --sample-period (got none)")
        still = None if self.still is None else still_samples(recording, self.still)
        return Request(
            target={SPECIFICATIONS[name][0]: value * SPECIFICATIONS[name][1] for name, value in specified.items()},
            ratio=self.ratio,
            noise=Noise(self.r, self.sigma, self.density, self.bandwidth_hz, still),
            momentum="auto" if self.momentum is None or math.isnan(self.momentum) else self.momentum,
            overshoot=self.overshoot,
            robust="auto" if self.robust is None else self.robust,
            two_speeds=self.two_speeds,
        )


@dataclass(frozen=True)
class FusionOptions(TuneOptions):
    """The options of `kalscope tune`: those of a fleet, and those about fusing."""

    notch: Annotated[
        float | None,
        number_option('Notch before the filter, Hz, or "auto": the strongest narrow line.', number_or("auto")),
    ] = None
    """NaN = auto."""
    fuse: Annotated[
        str | None,
        text_option("NAMES", "Fuse these channels, sensors of one quantity, such as a,b; then also --r a=4,b=9."),
    ] = None
    reference: Annotated[
        str | None, text_option("NAME", "With --fuse: the sensor without an offset; default: offsets add up to 0.")
    ] = None
    sensor_gains: Annotated[
        bool, typer.Option("--sensor-gains", help="With --fuse: estimate the gain of each sensor too.")
    ] = False

    def request(self, recording: Recording) -> Request:
        """As that of `TuneOptions`, with the notch."""
        auto = self.notch is not None and math.isnan(self.notch)
        return replace(super().request(recording), notch="auto" if auto else self.notch)

    def refuse_others(self, channel: str | None, every: bool) -> None:
        """Raise BadSetting for an option that --fuse excludes, or that needs --fuse where it is not given."""
        if self.fuse is None:
            if self.reference is not None or self.sensor_gains:
                option = "--sensor-gains" if self.reference is None else "--reference"
                raise BadSetting(f"{option} needs --fuse, the sensors of one quantity (got none)")
        elif self.notch is not None:
            raise BadSetting(f"--notch must be used without --fuse: it filters one channel (got {self.notch:g} Hz)")
        elif channel is not None or every:
            got = "--all" if every else f"--channel {channel!r}"
            raise BadSetting(f"--fuse must be used without --channel and --all: it names its channels (got {got})")


NOTHING = TuneOptions()
NO_FUSION = FusionOptions()


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


def save(
    recording: Recording,
    filters: Sequence[ChannelTuning],
    tuned: Set[str],
    output: Path,
    fusion: ChannelTuning | None = None,
) -> list[str]:
    """Save filters beside those that the file has for the same recording; returns notes about it for the user.

    Args:
        recording: where the channels are.
        filters: the filters, at least one.
        tuned: all channels that were tuned, those without a filter too.
        output: the file.
        fusion: the filter that fuses them; None = the one that the file has.
    """
    from kalscope.tuning.file import load_tuning, save_tuning
    from kalscope.tuning.tuning import Tuning

    before = None
    with suppress(BadFile):  # save_tuning reports what is wrong with it
        before = load_tuning(output) if output.is_file() else None
    if before and (before.sha256, before.sample_period) != (recording.sha256, recording.sample_period):
        before = None
    old = () if before is None else before.channels
    kept = [one for one in old if one.name in recording.names and one.name not in tuned]
    names = {one.name for one in filters} if fusion is None else set[str]()
    notes = [
        f"{one.name}: {one.chain.words} is replaced by the Kalman filter of q and r"
        for one in old
        if one.chain is not None and one.name in names
    ]
    if kept:
        notes.append(f"kept as they were in the tuning: {', '.join(one.name for one in kept)}")
    channels = sorted([*kept, *filters], key=lambda one: recording.names.index(one.name))
    fusion = fusion or (None if before is None else before.fusion)
    save_tuning(Tuning.of(recording, channels, selected=filters[0].name, fusion=fusion), output)
    return notes
