"""The filter that fuses several sensors of one quantity, as a tuning holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.errors import BadSetting
from kalscope.filtering.params import FilterParams
from kalscope.tuning.toml_text import shown


@dataclass(frozen=True)
class FusionTuning:
    """One filter for several sensors of one quantity: sensor i reads offset_i + gain_i·x + noise of variance r_i.

    Raises:
        BadSetting: The numbers are not valid parameters (see `FilterParams`), or there is not one value of each per
            sensor, or two sensors have the same name.
    """

    name: str
    """Name of the fused value."""
    unit: str
    """Unit of the fused value, "" where unknown."""
    sensors: tuple[str, ...]
    """Names of the sensors, as the channels of the recording; at least one, distinct."""
    q: float
    """Process-noise variance added per nominal sample period, unit², 0 … 1e300."""
    r: tuple[float, ...]
    """Measurement-noise variance of each sensor, in the square of what it reads, 0 … 1e300."""
    offset: tuple[float, ...] = ()
    """What each sensor reads where the fused value is 0; () = 0 for all."""
    gain: tuple[float, ...] = ()
    """By how much each sensor's reading grows with the fused value, not 0; () = 1 for all."""
    p0: float | None = None
    """Variance of the fused value before the first predict, unit², ≥ 0; None = exact diffuse start."""
    x0: float | None = None
    """Fused value before the first predict, unit; None = from the first finite reading. Needs p0."""
    gate: float | None = None
    """Outlier gate on v²/s of each reading, > 0; None = off."""
    momentum: float = 0.0
    """Momentum τ: how long the signal keeps its direction, in nominal sample periods, 0 … 1e5; 0 = it does not."""
    how: str = "by hand"
    """How the values were found, for the user: "by hand", "maximum likelihood", …"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        if len(set(self.sensors)) < len(self.sensors):
            raise BadSetting(f"sensors of a fusion must have distinct names (got {shown(list(self.sensors))})")
        for name, usual in (("offset", 0.0), ("gain", 1.0)):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, (usual,) * len(self.r))
        params = self.params
        if params.sensors != len(self.sensors):
            raise BadSetting(
                f"r of a fusion must have one value per sensor "
                f"(got {params.sensors} for {len(self.sensors)} sensors)"
            )
        for name in ("q", "p0", "x0", "gate", "momentum"):
            object.__setattr__(self, name, getattr(params, name))
        for name, column in (("r", params.sensor_r), ("offset", params.offset), ("gain", params.gain)):
            object.__setattr__(self, name, tuple(column.tolist()))

    @property
    def params(self) -> FilterParams:
        """The parameters as the filter takes them."""
        r, offset, gain = (np.array(values) for values in (self.r, self.offset, self.gain))
        return FilterParams(self.q, r, self.p0, self.x0, self.gate, self.momentum, offset, gain)
