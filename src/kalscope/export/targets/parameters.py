"""Parameters without code: JSON for your own program. It has no comments, so the words are values."""

from __future__ import annotations

import json
from typing import Any

from kalscope.export.float32 import runs_kalman
from kalscope.export.job import ExportJob, about, about_channel, ascii_squared, step_of
from kalscope.export.targets.c import numbers_of
from kalscope.filtering.classic import Chain
from kalscope.filtering.steady import SteadyState
from kalscope.filtering.two_speeds import SPIKE, START_MOVING, STOP_MOVING
from kalscope.tuning.toml_text import plain_chain
from kalscope.tuning.tuning import ChannelTuning

TWO_SPEEDS = {"start_moving": START_MOVING, "stop_moving": STOP_MOVING, "spike": SPIKE}
"""What a filter with two speeds needs besides its parameters."""


def json_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_parameters.json`; names are whole, in escapes."""
    document = {
        "format": f"kalscope-parameters-{2 if job.has_kinds or job.fuses else 1}",
        "about": list(about(job)),
        "sample_period_s": job.sample_period,
        "recording": {"name": _clean(job.source_name), "sha256": _clean(job.sha256)},
        "tool": _clean(job.tool),
        "date": _clean(job.date),
        "channels": [_channel(job, *named) for named in job.named_channels],
    }
    return {"kalscope_parameters.json": json.dumps(document, indent=2, allow_nan=False) + "\n"}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> dict[str, Any]:
    return {
        "name": _clean(channel.name),
        "identifier": word,
        "unit": _clean(channel.unit),
        **({"sensors": _sensors(job, channel)} if channel.sensors else {}),
        **({} if channel.chain is None else {"chain": _chain(channel.chain)}),
        **(_kalman(job, channel) if runs_kalman(channel) else {}),
        "about": list(about_channel(job, channel)),
    }


def _sensors(job: ExportJob, fusion: ChannelTuning) -> list[dict[str, Any]]:
    shares = fusion.params.shares.tolist()
    values = zip(fusion.sensors, job.sensor_identifiers, fusion.r, fusion.offset, fusion.gain, shares, strict=True)
    return [
        {"name": _clean(name), "identifier": word, "measurement_noise_r": r, "offset": b, "gain": c, "share": share}
        for name, word, r, b, c, share in values
    ]


def _kalman(job: ExportJob, one: ChannelTuning) -> dict[str, Any]:
    """The Kalman filter of a channel or a fusion; a null is an automatic start or a gate that is off."""
    steady = job.steady(one)
    return {
        "unit_of_variances": ascii_squared(one.unit),
        "process_noise_q": one.q,
        **({} if one.sensors else {"measurement_noise_r": one.r}),
        "start_variance_p0": one.p0,
        "start_value_x0": one.x0,
        "outlier_gate": one.gate,
        **({} if one.fast is None else {"fast": one.fast, "spikes": one.spikes, **TWO_SPEEDS}),
        **({"momentum": _momentum(steady, one)} if one.momentum > 0.0 else {}),
        "found": _clean(one.how),
        "steady_gain": steady.gain,
        "lag_samples": steady.lag_samples if one.q > 0.0 else None,  # JSON has no infinity
    }


def _chain(chain: Chain) -> dict[str, Any]:
    """The window of the median, 1 for none, a notch, the filter, their settings, and what they compute with."""
    known = {name: value for name, value in (plain_chain(chain) or {}).items() if value is not None}
    if chain.notch is not None:
        known["notch"] |= numbers_of(chain.notch)
    return {"words": chain.words, "median": 1, **known, **({} if chain.then is None else numbers_of(chain.then))}


def _momentum(steady: SteadyState, channel: ChannelTuning) -> dict[str, Any]:
    """How long the signal keeps its direction, and the constants of one sample period that follow."""
    constants = step_of(channel)
    return {
        "tau_samples": constants.pop("momentum"),
        **constants,
        "velocity_gain": steady.velocity_gain,
        "overshoot": steady.overshoot,
    }


def _clean(text: str) -> str:
    return text.encode("utf-8", "replace").decode()
