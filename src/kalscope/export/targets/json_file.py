"""JSON: the parameters for your own program. JSON has no comments, so the words are values."""

from __future__ import annotations

import json
from typing import Any

from kalscope.export.board.chain import runs_kalman
from kalscope.export.header_text import about, about_channel, ascii_squared
from kalscope.export.job import ExportJob, step_of
from kalscope.export.targets.stages import numbers_of
from kalscope.filtering.classic.chain import Chain
from kalscope.filtering.steady_state import SteadyState
from kalscope.tuning.chain_table import plain_chain
from kalscope.tuning.tuning import ChannelTuning

FORMAT, CHAIN_FORMAT, FUSION_FORMAT = "kalscope-parameters-1", "kalscope-parameters-2", "kalscope-fusion-1"
"""Name and number of each layout; the second one where any channel has a chain."""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_parameters.json`; names are whole, in escapes."""
    head = _head(job, CHAIN_FORMAT if job.has_chain else FORMAT)
    document = {**head, "channels": [_channel(job, *named) for named in job.named_channels]}
    return {"kalscope_parameters.json": _text(document)}


def fused_files(job: ExportJob) -> dict[str, str]:
    """`kalscope_fusion.json`; names are whole, in escapes."""
    fusion, steady = job.fusion, job.steady(job.fusion)
    shares = fusion.params.shares.tolist()
    values = zip(fusion.sensors, job.sensor_identifiers, fusion.r, fusion.offset, fusion.gain, shares, strict=True)
    fused = {
        "name": _clean(fusion.name),
        "identifier": job.identifiers[-1],
        "unit": _clean(fusion.unit),
        "unit_of_variances": ascii_squared(fusion.unit),
        "process_noise_q": fusion.q,
        **_start(fusion),
        **({"momentum": _momentum(steady, fusion)} if job.has_momentum else {}),
        "found": _clean(fusion.how),
        "steady_gain": steady.gain,
        "lag_samples": steady.lag_samples if fusion.q > 0.0 else None,
        "about": list(about_channel(job, job.fusion)),
    }
    sensors = [
        {"name": _clean(name), "identifier": word, "measurement_noise_r": r, "offset": b, "gain": c, "share": share}
        for name, word, r, b, c, share in values
    ]
    return {"kalscope_fusion.json": _text({**_head(job, FUSION_FORMAT), "fusion": fused, "sensors": sensors})}


def _head(job: ExportJob, layout: str) -> dict[str, Any]:
    return {
        "format": layout,
        "about": list(about(job)),
        "sample_period_s": job.sample_period,
        "recording": {"name": _clean(job.source_name), "sha256": _clean(job.sha256)},
        "tool": _clean(job.tool),
        "date": _clean(job.date),
    }


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _start(one: ChannelTuning) -> dict[str, float | None]:
    return {"start_variance_p0": one.p0, "start_value_x0": one.x0, "outlier_gate": one.gate}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> dict[str, Any]:
    """One channel; a null is an automatic start or a gate that is off."""
    return {
        "name": _clean(channel.name),
        "identifier": word,
        "unit": _clean(channel.unit),
        **({} if channel.chain is None else {"chain": _chain(channel.chain)}),
        **(_kalman(job, channel) if runs_kalman(channel) else {}),
        "about": list(about_channel(job, channel)),
    }


def _kalman(job: ExportJob, channel: ChannelTuning) -> dict[str, Any]:
    steady = job.steady(channel)
    return {
        "unit_of_variances": ascii_squared(channel.unit),
        "process_noise_q": channel.q,
        "measurement_noise_r": channel.r,
        **_start(channel),
        **({"momentum": _momentum(steady, channel)} if channel.momentum > 0.0 else {}),
        "found": _clean(channel.how),
        "steady_gain": steady.gain,
        "lag_samples": steady.lag_samples if channel.q > 0.0 else None,  # JSON has no infinity
    }


def _chain(chain: Chain) -> dict[str, Any]:
    """The window of the median, 1 for none, then the filter, its settings, and what it computes with."""
    known = {name: value for name, value in (plain_chain(chain) or {}).items() if value is not None}
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
