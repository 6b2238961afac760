"""From samples to a tuned filter in one call: `kalscope.tune`."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any, Literal

from numpy.typing import ArrayLike

from kalscope.common.files import check_new, write_atomic
from kalscope.common.text import number, squared
from kalscope.errors import BadSetting
from kalscope.estimation.request import FitResult, Noise, Request, find_parameters
from kalscope.export.page import make_page
from kalscope.export.registry import export_tuning, write_files
from kalscope.filtering.filter import FilterResult, like_series
from kalscope.filtering.params import FilterParams, one_record
from kalscope.recording import Recording
from kalscope.tuning.file import save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning


@dataclass(frozen=True, repr=False)
class TuneResult:
    """What `tune` found for one channel."""

    recording: Recording
    """The samples, as one channel."""
    found: FitResult
    """The filter and why it was chosen."""
    given: Any
    """The samples as they were given: an array, or a Series with its index."""

    @property
    def params(self) -> FilterParams:
        """The parameters of the filter."""
        assert self.found.params is not None  # None only of several sensors
        return self.found.params

    @property
    def message(self) -> str:
        """What was found and what it means, in sentences."""
        return self.found.message

    @property
    def result(self) -> FilterResult:
        """The filter over the samples."""
        return self.tuning.channels[0].filter.run(self.recording.values[:, 0], _steps(self.recording))

    @property
    def x(self) -> Any:
        """The filtered signal, an array; of a Series a Series with the same index."""
        return like_series(self.given, self.result.x)

    @property
    def tuning(self) -> Tuning:
        """The tuning, as a tuning file holds it."""
        name, unit = self.recording.names[0], self.recording.units[0]
        one = replace(ChannelTuning.of_params(name, unit, self.params, self.found.how), chain=self.found.chain)
        return Tuning.of(self.recording, [one], selected=name)

    def to_frame(self) -> Any:
        """A DataFrame of z, x and its variance p, with the index of the Series, else the time; needs pandas."""
        import pandas as pd  # pyright: ignore[reportMissingTypeStubs]

        result, index = self.result, getattr(self.given, "index", None)
        columns = {"z": self.recording.values[:, 0], "x": result.x, "p": result.p}
        return pd.DataFrame(columns, index=self.recording.time if index is None or callable(index) else index)

    def plot(self, ax: Any = None) -> Any:
        """Draw the raw and the filtered signal into the axes, or new ones, and return them; needs matplotlib."""
        if ax is None:
            from matplotlib import pyplot as plt

            ax = plt.subplots()[1]
        time, (name,), (unit,) = self.recording.time, self.recording.names, self.recording.units
        ax.plot(time, self.recording.values[:, 0], color="0.6", linewidth=0.8, label="raw")
        ax.plot(time, self.result.x, color="tab:orange", label="filtered")
        ax.set_xlabel("sample" if self.recording.sample_period is None else "time (s)")
        ax.set_ylabel(f"{name} ({unit})" if unit else name)
        ax.legend()
        return ax

    def export(self, target: str, folder: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
        """Write the filter as the files of a target such as "arduino"; returns their paths.

        Raises:
            BadSetting: the target is unknown; or a file is there and `force` is off.
        """
        return write_files(export_tuning(self.tuning, target), Path(folder), force=force)

    def page(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write one HTML file that shows the samples, the filter and its sliders in any browser.

        Raises:
            BadSetting: there are no samples; or the file is there and `force` is off.
        """
        check_new(Path(path), force=force)
        write_atomic(Path(path), make_page(self.recording, self.tuning.channels).encode())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the tuning file, as `save_tuning` does."""
        save_tuning(self.tuning, path)

    def __repr__(self) -> str:
        unit = f" {squared(self.recording.units[0])}" if self.recording.units[0] else ""
        momentum = f", momentum = {number(self.params.momentum)}" if self.params.momentum else ""
        pair = f"q = {number(self.params.q, 4)}{unit}, r = {number(float(self.params.r), 4)}{unit}"
        return f"<TuneResult {self.recording.names[0]}: {pair}{momentum}>"

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(repr(self)[1:-1])}</b></p><p>{escape(self.message)}</p>"


def tune(
    z: ArrayLike | Recording,
    *,
    lag_ms: float | None = None,
    ratio: float | None = None,
    r: float | None = None,
    sample_period: float | None = None,
    channel: str | None = None,
    notch: float | Literal["auto"] | None = None,
) -> TuneResult:
    """Find the filter of one channel, as `kalscope tune` and the dashboard do.

    Args:
        z: samples, shape (n,), NaN where missing; a Series, whose index may hold the time; or a Recording.
        lag_ms: the lag that is wanted, ms; needs a sample period. None = no goal.
        ratio: q/r itself.
        r: the variance of the measurement noise where it is known, unit².
        sample_period: nominal sample period, s; None = that of the time index or of the recording.
        channel: which channel of a recording; None = its only one.
        notch: what a notch before the filter takes out, Hz; "auto" = the strongest narrow line; None = no notch.

    Raises:
        BadSetting: z holds inf or has another shape, or several channels and `channel` is None; the request
            contradicts itself or is out of range; a lag without a sample period.
    """
    recording = z if isinstance(z, Recording) else Recording.of_samples(z)
    if channel is None and len(recording.names) != 1:
        raise BadSetting(f"channel must be one of {', '.join(recording.names)} (got none)")
    at = recording.index(channel) if channel is not None else 0
    period = recording.sample_period if sample_period is None else sample_period
    samples, _ = one_record(recording.values[:, at], None)
    one = replace(
        recording,
        names=(recording.names[at],),
        units=(recording.units[at],),
        values=samples[:, None],
        truth=None,
        sample_period=period,
    )
    target = {} if lag_ms is None else {"lag_s": lag_ms / 1000.0}
    request = Request(target=target, ratio=ratio, noise=Noise(r=r), notch=notch)
    found = find_parameters(samples, request, dt=_steps(one), sample_period=period)
    return TuneResult(one, found, samples if isinstance(z, Recording) else z)


def _steps(recording: Recording) -> Any:
    return recording.steps() if recording.gaps == "dt" else None
