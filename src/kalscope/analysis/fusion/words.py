"""What is said of fused sensors, in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from kalscope.analysis.fusion.result import Fault, HeldOut, SensorVerdict
from kalscope.common.text import count, gate_text, lag_text, number, percent, plural
from kalscope.estimation.fusion.shared import Shared
from kalscope.estimation.fusion.words import common_part

CLOSE = 0.005
"""Relative differences below this count as none: both errors read the same."""

MIN_SHARE = 1e-9
"""A smaller share counts as none, as that beside a sensor without noise."""


@dataclass(frozen=True)
class Words:
    """Names and units for the sentences on a record."""

    names: tuple[str, ...]
    """The sensors."""
    unit: str
    """The unit of the quantity; "" where unknown."""
    period: float | None
    """Sample period, s; None where unknown."""

    def size(self, value: float) -> str:
        """A size with its unit."""
        return f"{number(value)} {self.unit}".rstrip()

    def headline(
        self,
        error: float,
        single: Sequence[float],
        best: int,
        sensors: Sequence[SensorVerdict],
        seen: HeldOut | None,
        shared: Shared | None,
    ) -> str:
        """What fusing brings; no comparison by predicted errors where the record contradicts them."""
        stuck = [one.name for one in sensors if "stuck" in one.faults]
        drift = max(one.drift for one in sensors)
        if math.isinf(error):
            return "No sensor has a reading after the start, so nothing can be said."
        if len(single) == 1:
            return f"The filtered value of {self.names[0]} has an error of {self.size(error)} (1 σ, predicted)."
        if drift > error:
            return (
                f"The sensors drift apart by up to {self.size(drift)}, so the fused value may be wrong by as much; "
                f"only if they read one quantity is its error the predicted {self.size(error)} (1 σ)."
            )
        if shared is not None:
            who = common_part([self.names[i] for i in shared.sensors], shared.correlation)
            return f"{who}, so the fused value can be worse than its predicted error of {self.size(error)} (1 σ)."
        less = 0.0 if seen is None else _saved(seen)
        if seen is not None and less < 0.0:
            return (
                f"The fused value predicts the next reading {percent(-less)} worse than {self.names[seen.best]} "
                f"alone, so its error is larger than the predicted {self.size(error)} (1 σ)."
                f"{f' {stuck[0]} is stuck.' if stuck else ''}"
            )
        saved = 1.0 - error / single[best] if single[best] > 0.0 else 0.0
        said = "the same as" if saved < CLOSE else f"{percent(saved)} less than"
        return (
            f"The fused value has an error of {self.size(error)} (1 σ, predicted), {said} the best single sensor, "
            f"{self.names[best]} ({self.size(single[best])})."
            f"{f' {stuck[0]} is stuck, so it can be larger.' if stuck else ''}"
        )

    def held_out(self, seen: HeldOut, *, unseen: bool) -> str:
        """How well the second half is predicted; `unseen`: by parameters that the first half alone gave."""
        best = f"{self.names[seen.best]} alone"
        told = (
            f"In the second half{', unseen by the fit,' if unseen else ''} the next reading is predicted to "
            f"{self.size(seen.fused)}, its own noise included"
        )
        less = _saved(seen)
        if not less:
            return f"{told}: as well as by {best}, within chance."
        return f"{told}: {percent(abs(less))} {'better' if less > 0.0 else 'worse'} than by {best}."

    def shares(self, shares: Sequence[float]) -> str:
        """What each sensor contributes."""
        return f"While all answer, the fused value is {self.parts(shares)}."

    def parts(self, shares: Sequence[float]) -> str:
        """Shares as a list: 60 % a, 30 % b and 10 % c."""
        written = [
            f"{percent(share, 3 if share > 0.985 else 2)} {name}"
            for name, share in zip(self.names, shares, strict=True)
            if share > MIN_SHARE
        ]
        return written[0] if len(written) == 1 else f"{', '.join(written[:-1])} and {written[-1]}"

    def fault(self, sensor: SensorVerdict, fault: Fault, noise: float, stuck_at: str, pair: tuple[int, ...]) -> str:
        """One fault of a sensor.

        Args:
            sensor: what was found.
            fault: which.
            noise: standard deviation of its noise, on the scale of the quantity.
            stuck_at: what it reads where it is stuck.
            pair: two sensors of which it is one, where no third one tells which of them it is; else ().
        """
        name = sensor.name
        two = " and ".join(self.names[i] for i in pair)
        spikes = plural(sensor.spikes, "spike")
        drifted = f"{self.size(sensor.drift)} within the record"
        changed = f"changes {number(sensor.noise_ratio, 2)} × within the record"
        said: dict[Fault, str] = {
            "silent": f"{name} has no reading{self._when(sensor.silent)}.",
            "stuck": f"{name} is stuck at {stuck_at}{self._when(sensor.stuck)}: leave it out there.",
            "drift": f"{name} drifts against the others by {drifted} (σ of its noise: {self.size(noise)}).",
            "noise": f"The noise variance of {name} {changed}: one r cannot fit all of it.",
            "spikes": f"{name} has {spikes} that no other sensor confirms: set an outlier gate.",
        }
        if pair and fault == "drift":
            return f"{two} drift apart by {drifted}; two sensors cannot show which of them drifts."
        if pair and fault == "noise":
            return f"The noise variance of {two} {changed}; two sensors cannot show which of them it is."
        return said[fault]

    def dropped(self, sensor: SensorVerdict, error: float) -> str:
        """What happens when it drops out."""
        if math.isinf(sensor.error_without):
            return f"Without {sensor.name} no reading is left."
        without = sensor.error_without
        more = without / error - 1.0 if error > 0.0 else 0.0
        change = "as large as with it" if more < CLOSE else f"{percent(more)} more than with it"
        change = "with it 0" if error == 0.0 < without else change
        return (
            f"If {sensor.name} drops out, the error is {self.size(sensor.error_without)}, {change}; "
            f"the fused value is then {self.parts(sensor.shares_without.tolist())}."
        )

    def sticks(self, sensor: SensorVerdict, gate: float | None) -> str:
        """What happens when it sticks at one value, which no filter can see in a single reading."""
        if math.isinf(sensor.error_without):
            return f"If {sensor.name} sticks at one value, the filter follows it."
        pull = sensor.pull if sensor.pull > MIN_SHARE else 0.0
        held = "" if gate is None else f", with the gate of {gate_text(gate)}"
        return (
            f"If {sensor.name} sticks at one value, the fused value ends {percent(pull)} of the way to it"
            f"{held}; leave it out then."
        )

    def _when(self, stretch: tuple[int, int]) -> str:
        first, last = stretch
        rows = last - first
        long = lag_text(rows, self.period) if self.period else f"{count(rows)} rows"
        return f" for {long} (rows {count(first)} to {count(last - 1)})"


def _saved(seen: HeldOut) -> float:
    """By which share fusing predicts better than the best sensor alone, below 0 where worse; 0 within chance."""
    best = float(seen.single[seen.best])
    less = 1.0 - seen.fused / best if best > 0.0 else 0.0
    return less if seen.is_certain and abs(less) >= CLOSE else 0.0
