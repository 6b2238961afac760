"""JSON: the parameters for your own program. JSON has no comments, so the words are values."""

from __future__ import annotations

import json
from typing import Any

from kalscope.export.header_text import about, about_channel, ascii_squared
from kalscope.export.job import ExportJob, step_of
from kalscope.filtering.steady_state import SteadyState
from kalscope.tuning.tuning import ChannelTuning

FORMAT = "kalscope-parameters-1"
"""Name and number of the layout."""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_parameters.json`; names are whole, in escapes."""
    document = {
        "format": FORMAT,
        "about": list(about(job)),
        "sample_period_s": job.sample_period,
        "recording": {"name": _clean(job.source_name), "sha256": _clean(job.sha256)},
        "tool": _clean(job.tool),
        "date": _clean(job.date),
        "channels": [_channel(job, *named) for named in job.named_channels],
    }
    return {"kalscope_parameters.json": json.dumps(document, indent=2, allow_nan=False) + "\n"}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> dict[str, Any]:
    """One channel; a null is an automatic start or a gate that is off."""
    steady = job.steady(channel)
    return {
        "name": _clean(channel.name),
        "identifier": word,
        "unit": _clean(channel.unit),
        "unit_of_variances": ascii_squared(channel.unit),
        "process_noise_q": channel.q,
        "measurement_noise_r": channel.r,
        "start_variance_p0": channel.p0,
        "start_value_x0": channel.x0,
        "outlier_gate": channel.gate,
        **({"momentum": _momentum(steady, channel)} if channel.momentum > 0.0 else {}),
        "found": _clean(channel.how),
        "steady_gain": steady.gain,
        "lag_samples": steady.lag_samples if channel.q > 0.0 else None,  # JSON has no infinity
        "about": list(about_channel(job, channel)),
    }


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
