"""`kalscope tune --fuse`: the text or JSON of the answer, and the tuning file."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from kalscope.analysis.fused import SensorJudgement
from kalscope.cli.console import progress_line
from kalscope.cli.tune.fusion.answer import FusionAnswer, answer_fusion
from kalscope.cli.tune.fusion.options import FusionOptions
from kalscope.cli.tune.fusion.words import details_of, summary_of
from kalscope.cli.tune.options import TuneOptions
from kalscope.cli.tune.plain import finite
from kalscope.cli.tune.saved import kept_channels, saved_before
from kalscope.cli.tune.summary import reading_lines
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.fusion.result import FusionEstimate
from kalscope.recording import Recording
from kalscope.sources.readers import account
from kalscope.tuning.choose_fusion import FUSED, fusion_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import save_tuning


def tune_fusion(recording: Recording, asked: TuneOptions, fusing: FusionOptions) -> FusionAnswer:
    """The answer, with progress on a terminal; errors as `answer_fusion`."""
    with progress_line() as show:
        return answer_fusion(recording, asked, fusing, Progress(show))


def text_of(recording: Recording, answer: FusionAnswer, details: bool) -> str:
    """How the recording was read, what the fusion is worth, and its sensors."""
    lines = [*reading_lines(recording), *summary_of(answer), *(details_of(answer) if details else [])]
    return "\n".join(lines) + "\n"


def json_of(recording: Recording, answer: FusionAnswer) -> str:
    """Everything as one object."""
    head = {"source": recording.source, "sha256": recording.sha256, "reading": account.as_plain(recording)}
    return json.dumps(finite({**head, **_plain(answer)}), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(answer: FusionAnswer) -> dict[str, Any]:
    found, params, verdict = answer.estimate, answer.params, answer.verdict
    sensors = [
        {
            "name": name,
            "unit": answer.units[i],
            "readings": answer.readings[i],
            "r": None if params is None else float(params.sensor_r[i]),
            "offset": None if params is None else float(params.offset[i]),
            "gain": None if params is None else float(params.gain[i]),
            "share": None if params is None else float(params.shares[i]),
            "r_interval": found.r_interval[i].tolist(),
            "offset_interval": found.offset_interval[i].tolist(),
            "gain_interval": found.gain_interval[i].tolist(),
            "spikes": found.spikes[i].tolist(),
            "judgement": None if verdict is None else _sensor(verdict.sensors[i]),
        }
        for i, name in enumerate(answer.sensors)
    ]
    return {
        "fused": list(answer.sensors),
        "unit": answer.unit,
        "rows": answer.rows,
        "sample_period": answer.sample_period,
        **{name: None if params is None else getattr(params, name) for name in ("q", "momentum", "gate")},
        "verdict": found.verdict,
        "message": found.message,
        "shared_noise": _shared(found),
        "notes": list(found.notes),
        "how": answer.how,
        "q_interval": found.q_interval.tolist(),
        "loglik": found.loglik,
        "steady": None if answer.steady is None else asdict(answer.steady),
        "error": None if verdict is None else verdict.error,
        "held_out": None if verdict is None or verdict.prediction is None else asdict(verdict.prediction),
        "judgement": [] if verdict is None else list(verdict.sentences),
        "sensors": sensors,
    }


def _sensor(one: SensorJudgement) -> dict[str, Any]:
    names = (
        *("name", "share", "answered", "error", "error_without", "shares_without", "pull"),
        *("drift", "noise_ratio", "spikes", "stuck", "silent", "faults"),
    )
    sentences = [*(fault.text for fault in one.findings), *one.if_it_fails]
    return {**{name: getattr(one, name) for name in names}, "sentences": sentences}


def _shared(found: FusionEstimate) -> dict[str, Any] | None:
    one = found.shared
    return one and {"sensors": [found.names[i] for i in one.sensors], "correlation": one.correlation}


def save_fusion(recording: Recording, answer: FusionAnswer, output: Path) -> list[str]:
    """Save the fusion, and for each sensor the single filter with its noise; returns notes for the user."""
    params = answer.params
    if params is None:
        raise BadSetting(
            f"-o needs a usable q and r of each sensor, and the record gives none: {answer.estimate.message}"
        )
    fusion = fusion_tuning(params, answer.sensors, answer.unit, answer.how)
    single = [
        ChannelTuning(
            name, unit, params.q * gain * gain, r, how=answer.how, gate=params.gate, momentum=params.momentum
        )
        for name, unit, r, gain in zip(answer.sensors, answer.units, fusion.r, fusion.gain, strict=True)
    ]
    kept = kept_channels(recording, set(answer.sensors), saved_before(recording, output))
    channels = sorted([*kept, *single], key=lambda one: recording.names.index(one.name))
    named = replace(fusion, name=_free_name(recording))
    tuning = Tuning.of(recording, channels, selected=answer.sensors[0], fusion=named)
    save_tuning(tuning, output)
    return [f"kept as they were in the tuning: {', '.join(one.name for one in kept)}"] if kept else []


def _free_name(recording: Recording) -> str:
    """A name for the fused value that no channel has."""
    name, more = FUSED, 2
    while name in recording.names:
        name, more = f"{FUSED} {more}", more + 1
    return name
