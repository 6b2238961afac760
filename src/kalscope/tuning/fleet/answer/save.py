"""The answer as files: the tuning of the filter for all, and fleet.json for programs."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.common.files import atomic_file, write_atomic
from kalscope.common.text import count, escaped, percent
from kalscope.common.version import program
from kalscope.estimation.fleet.changes import FALSE_ALARM
from kalscope.filtering.steady_state import steady_state
from kalscope.tuning.fleet.answer.answer import WITHIN, Answer, Shared
from kalscope.tuning.fleet.answer.devices import Devices
from kalscope.tuning.fleet.answer.own import RECORD, check_tuning, digest_of, own_digest
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.store.begun import SUMMARY, TABLE, TUNING
from kalscope.tuning.fleet.store.row import FINISHED
from kalscope.tuning.fleet.store.table import schema
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope.tuning.tuning_file import dumps, save_tuning

MAX_LISTED = 1000
"""Devices of a list in it; the table has all."""


def save_answer(answer: Answer, folder: Path) -> None:
    """Write what each device loses into the table, and both files, each whole or not at all.

    Without a filter for all there is no tuning file.

    Raises:
        OSError: The folder cannot be written; the files are unchanged.
        BadSetting: there is a tuning file that no fleet wrote; the files are unchanged.
    """
    if answer.shared is not None:
        check_tuning(folder)
    _finish_table(answer, folder / TABLE)
    before = own_digest(folder)
    tuning = None if answer.shared is None else tuning_of(answer.devices, answer.shared)
    digests = [one for one in (before, tuning and digest_of(dumps(tuning))) if one]
    plain = as_plain(answer) | {RECORD: digests}  # first, so that a run that is killed here knows its own file
    text = escaped(json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False))
    write_atomic(folder / SUMMARY, (text + "\n").encode("utf-8", "replace"))
    if tuning is not None:
        save_tuning(tuning, folder / TUNING)
    elif before is not None:
        (folder / TUNING).unlink()


def _finish_table(answer: Answer, path: Path) -> None:
    """The table with what each device loses, in place of the data behind that; row group by row group."""
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    losses = {} if answer.shared is None else _losses(answer.shared)
    kept = pa.schema([one for one in schema() if one.name in FINISHED])
    with (
        atomic_file(path) as file,
        parquet.ParquetFile(path, memory_map=False) as before,
        parquet.ParquetWriter(file, kept, compression="zstd") as writer,
    ):
        first = 0
        for i in range(before.num_row_groups):
            rows = before.read_row_group(i, columns=list(FINISHED))
            here = slice(first, first + len(rows))
            first = here.stop
            for name, values in losses.items():
                column = pa.array(values[here], pa.float64(), mask=~np.isfinite(values[here]))
                rows = rows.set_column(FINISHED.index(name), name, column)
            writer.write_table(rows.cast(kept))


def tuning_of(devices: Devices, shared: Shared) -> Tuning:
    """The tuning of the filter for all."""
    q, r, momentum = shared.params.q, float(shared.params.r), shared.params.momentum
    served = f", serves {percent(shared.served)} of {count(shared.judged)} within {percent(WITHIN)}"
    how = f"one filter for a fleet, {shared.how}{served if shared.judged else ''}"
    channel = ChannelTuning(devices.channel, devices.unit, q, r, how=how, momentum=momentum)
    return Tuning((channel,), source_name=f"fleet of {len(devices)}", sample_period=devices.sample_period)


def as_plain(answer: Answer) -> dict[str, Any]:
    """The answer in values that JSON can represent; None for what is not finite."""
    devices = answer.devices
    return {
        "tool": program(),
        "rows": len(devices),
        "usable": int(devices.usable.sum()),
        "failed": devices.failed,
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
        "q": shared.params.q,
        "r": float(shared.params.r),
        "ratio": shared.fit.ratio,
        "ratio_interval": [_finite(end) for end in shared.fit.ratio_interval],
        "momentum": shared.params.momentum,
        "lag_samples": settled.lag_samples,
        "noise_reduction_db": settled.noise_reduction_db,
        "how": shared.how,
        "within": WITHIN,
        "judged": shared.judged,
        "served": shared.served,
        "lost": {name: _spread(values) for name, values in _losses(shared).items()},
        "not_served": [
            {"id": devices.ids[i], "channel": devices.channels[i]}
            | {name: _finite(float(values[i])) for name, values in _losses(shared).items()}
            for i in shared.not_served[:MAX_LISTED]
        ],
    }


def _losses(shared: Shared) -> dict[str, Array]:
    """What each device loses, by its name in the table and in fleet.json."""
    one = shared.losses
    return {"lag_loss_samples": one.lag_samples, "noise_loss_db": one.noise_db, "error_growth": one.error}


def _spread(values: Array) -> dict[str, float] | None:
    """Median and the ends of the middle 90 % of the devices; None where none is judged."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    low, middle, high = np.percentile(known, (5.0, 50.0, 95.0)).tolist()
    return {"median": middle, "p5": low, "p95": high}


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
