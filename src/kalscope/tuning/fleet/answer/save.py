"""The answer as files: the tuning of the filter for all, and fleet.json for programs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from kalscope.common.files import write_atomic
from kalscope.common.version import program
from kalscope.estimation.fleet.changes import FALSE_ALARM
from kalscope.filtering.arrays import scalar
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.fleet.answer.answer import WITHIN, Answer, Shared
from kalscope.tuning.fleet.answer.devices import Devices
from kalscope.tuning.fleet.answer.own import RECORD, check_tuning, digest_of, own_digest
from kalscope.tuning.fleet.store.begun import SUMMARY, TUNING
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import dumps, save_tuning

MAX_LISTED = 1000
"""Devices of a list in it; the table has all."""


def save_answer(answer: Answer, folder: Path) -> None:
    """Write both files, each whole or not at all. Without a filter for all there is no tuning file.

    Raises:
        OSError: The folder cannot be written; the files are unchanged.
        BadSetting: there is a tuning file that no fleet wrote; the files are unchanged.
    """
    if answer.shared is not None:
        check_tuning(folder)
    before = own_digest(folder)
    tuning = None if answer.shared is None else tuning_of(answer.devices, answer.shared)
    digests = [one for one in (before, tuning and digest_of(dumps(tuning))) if one]
    plain = as_plain(answer) | {RECORD: digests}  # first, so that a run that is killed here knows its own file
    text = json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(folder / SUMMARY, (text + "\n").encode("utf-8", "replace"))
    if tuning is not None:
        save_tuning(tuning, folder / TUNING)
    elif before is not None:
        (folder / TUNING).unlink()


def tuning_of(devices: Devices, shared: Shared) -> Tuning:
    """The tuning of the filter for all."""
    q, r, momentum = (scalar(value) for value in (shared.params.q, shared.params.r, shared.params.momentum))
    channel = ChannelTuning(devices.channel, devices.unit, q, r, how=shared.how, momentum=momentum)
    return Tuning((channel,), source_name=f"fleet of {len(devices)}", sample_period=devices.sample_period)


def as_plain(answer: Answer) -> dict[str, Any]:
    """The answer in values that JSON can say; None for what is not finite."""
    devices = answer.devices
    return {
        "tool": program(),
        "rows": len(devices),
        "usable": int(devices.usable.sum()),
        "reasons": dict(devices.reasons.most_common(MAX_LISTED)),
        "channel": devices.channel,
        "unit": devices.unit,
        "sample_period": devices.sample_period,
        "one_filter": _shared(answer),
        "why_not": answer.refusal or None,
        "unlike": {name: _unlike(answer, name) for name in answer.unlike},
        "changed": {name: _changed(answer, name) for name in answer.changed},
    }


def _shared(answer: Answer) -> dict[str, Any] | None:
    shared, devices = answer.shared, answer.devices
    if shared is None:
        return None
    settled = steady_state(shared.params, devices.sample_period)
    return {
        "q": scalar(shared.params.q),
        "r": scalar(shared.params.r),
        "ratio": shared.fit.ratio,
        "ratio_interval": [_finite(end) for end in shared.fit.ratio_interval],
        "momentum": scalar(shared.params.momentum),
        "lag_samples": scalar(settled.lag_samples),
        "noise_reduction_db": scalar(settled.noise_reduction_db),
        "how": shared.how,
        "within": WITHIN,
        "served": shared.served,
        "not_served": [
            {"id": devices.ids[i], "channel": devices.channels[i], "growth": float(shared.growth[i])}
            for i in shared.not_served[:MAX_LISTED]
        ],
    }


def _unlike(answer: Answer, name: str) -> dict[str, Any]:
    one, devices = answer.unlike[name], answer.devices
    values = getattr(devices, name)
    return {
        "expected_by_chance": one.expected,
        "middle": None if math.isnan(one.middle) else math.exp(one.middle),
        "devices": [
            {
                "id": devices.ids[i],
                "channel": devices.channels[i],
                name: float(values[i]),
                "z": _finite(float(one.z[i])),
            }
            for i in one.devices[:MAX_LISTED]
        ],
    }


def _changed(answer: Answer, name: str) -> dict[str, Any]:
    one, found, devices = answer.changed[name], answer.changed[name].found, answer.devices
    return {
        "false_alarm": FALSE_ALARM,
        "devices": [
            {
                "device": one.name(i),
                "recordings": int(found.files[i]),
                "since": devices.ids[one.since(i)],
                "factor": _finite(one.factor(i)),
                "p": float(found.adjusted_p[i]),
            }
            for i in map(int, found.changed[:MAX_LISTED])
        ],
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
