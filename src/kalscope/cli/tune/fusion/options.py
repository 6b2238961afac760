"""What the user of `kalscope tune --fuse` asks for and knows, as options, and in the words of `estimate_fusion`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from kalscope.cli.options import text_option
from kalscope.errors import BadSetting

if TYPE_CHECKING:
    from kalscope.cli.tune.options import TuneOptions
    from kalscope.estimation.finding import Request
    from kalscope.recording import Recording


@dataclass(frozen=True)
class FusionOptions:
    """The options about fusing; all at their defaults where channels are tuned one by one."""

    names: str | None = None
    """The channels to fuse; None = none."""
    reference: str | None = None
    """The sensor whose offset is 0 and whose gain is 1; None = what all share is unknown."""
    gains: bool = False
    """Whether the gain of each sensor is estimated too."""

    def refuse_others(self, channel: str | None, every: bool) -> None:
        """Raise BadSetting for an option that --fuse excludes, or that needs --fuse where it is not given."""
        if self.names is None:
            for option, given in (("--reference", self.reference is not None), ("--sensor-gains", self.gains)):
                if given:
                    raise BadSetting(f"{option} needs --fuse, the sensors of one quantity (got none)")
        elif channel is not None or every:
            got = "--all" if every else f"--channel {channel!r}"
            raise BadSetting(f"--fuse must be used without --channel and --all: it names its channels (got {got})")


NONE = FusionOptions()


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
) -> FusionOptions:
    """The options in place of the parameter `fusing` of the command; see `with_options`."""
    return FusionOptions(fuse, reference, sensor_gains)


def known_noise(asked: TuneOptions, recording: Recording, sensors: tuple[str, ...]) -> list[float]:
    """The r of each sensor that is known, unit²; NaN where it is to be estimated.

    Raises:
        BadSetting: an option names another sensor, or a sensor shows no still stretch.
    """
    from dataclasses import replace

    from kalscope.tuning.fused_channels import for_each_sensor

    for option, given in asked.each.items():
        values = for_each_sensor(sensors, option, given)
        return [value * value if option == "--sigma" else value for value in values]
    dt = recording.steps() if recording.gaps == "dt" else None
    noise = replace(asked, each={}).request(recording).noise
    known = [noise.resolve(recording.channel(name), dt) for name in sensors]
    return [math.nan if one is None else one[0] for one in known]


def request_of(asked: TuneOptions, recording: Recording) -> Request:
    """The target, momentum and robustness that were asked for; without noise: each sensor has its own.

    Raises:
        BadSetting: an option that a fusion cannot have.
    """
    from dataclasses import replace

    from kalscope.estimation.finding import Noise

    if asked.method != "ml":
        raise BadSetting(f"--method must be ml with --fuse, the only one for several sensors (got {asked.method})")
    request = replace(replace(asked, each={}).request(recording), noise=Noise())
    request.checked_momentum()
    return request
