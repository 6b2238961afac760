"""A page that anyone can open: a recording with its filter and sliders, or a page that reads simple tables.

The filter of the page is the exported JavaScript; `page_files` has the rest, and uPlot 1.6.32 (MIT) for charts.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.common.text import count, program, sample_rate
from kalscope.errors import BadSetting
from kalscope.export.job import fill_template
from kalscope.filtering.params import FilterParams
from kalscope.recording import Recording
from kalscope.tuning.tuning import ChannelTuning

FILES = Path(__file__).parent / "page_files"
MAX_BYTES = 4_900_000
"""Of the packed samples: the page has at most 5 MB."""
MAX_DIGITS = 7
"""Decimals up to which samples are packed as whole numbers."""
MISSING = np.int32(-(2**31))


def make_page(
    recording: Recording | None = None, filters: Sequence[ChannelTuning] = (), selected: str | None = None
) -> str:
    """The page as text; it loads nothing, and every word from outside is data or escaped.

    Args:
        recording: what is shown; None = a page that reads simple tables itself.
        filters: the filter of each channel that is shown, at the recording's sample period.
        selected: the channel that is shown first; None = the first.

    Raises:
        BadSetting: the recording has no samples, or a filter is a chain, has two speeds or fuses sensors.
    """
    data = {} if recording is None else _data(recording, filters, selected)
    title = "Tune a Kalman filter" if recording is None else recording.title or recording.source or "Recording"
    chart, script = _read("uPlot.iife.min.js"), "\n".join((_filter(), _read("model.js"), _read("page.js")))
    style = _read("uPlot.min.css") + _read("page.css")
    scripts = " ".join(map(_hash, (chart, script)))
    about = "Best fit of q and r, sliders, and code for a device. Nothing leaves this page."
    return Template(_read("page.html")).substitute(
        policy=f"default-src 'none'; script-src {scripts}; style-src {_hash(style)}; base-uri 'none'",
        title=escape(title),
        about=escape(data.get("about", about)),
        footer=f"Made by {escape(program())}. Chart: uPlot, MIT licence, © 2025 Leon Sorokin.",
        style=style,
        chart=chart,
        script=script,
        data=json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
    )


def _read(name: str) -> str:
    return (FILES / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """What a content security policy allows to run."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _filter() -> str:
    """The classes of the exported JavaScript, without filters."""
    return fill_template("kalscope_filter.mjs.txt", frozenset({"momentum"}), about="", first="", filters="")


def _data(recording: Recording, filters: Sequence[ChannelTuning], selected: str | None) -> dict[str, Any]:
    """What the page shows, as JSON holds it."""
    if not len(recording):
        raise BadSetting("a page must have samples to show (got none)")
    for one in filters:
        if one.sensors or one.chain is not None or one.fast is not None:
            kind = "fuses sensors" if one.sensors else "is a chain" if one.chain is not None else "has two speeds"
            raise BadSetting(f"a page must show Kalman filters of one channel each ({one.name!r} {kind})")
    names = [one.name for one in filters]
    columns = [recording.values[:, recording.index(name)] for name in names]
    time = None if _is_even(recording) else recording.time - recording.time[0]
    rows = len(recording)
    while True:  # the first rows, where all of them do not fit
        packed = [_packed(column[:rows]) for column in (*columns, *(() if time is None else (time,)))]
        size = sum(len(each["data"]) for each in packed)
        if size <= MAX_BYTES:
            break
        rows = int(0.95 * rows * MAX_BYTES / size)
    period = recording.sample_period
    shown = count(rows) if rows == len(recording) else f"the first {count(rows)} of {count(len(recording))}"
    about = [f"{shown} samples", *(() if period is None else (sample_rate(period),))]
    if rows < len(recording):
        about.append("more do not fit into 5 MB")
    return {
        "about": ", ".join(about),
        "period": period,
        "time": None if time is None else packed[-1],
        "selected": names.index(selected) if selected in names else 0,
        "channels": [
            {"name": one.name, "unit": one.unit, "z": z, "start": _numbers(one.params)}
            for one, z in zip(filters, packed, strict=False)
        ],
    }


def _numbers(params: FilterParams) -> dict[str, float | None]:
    return {name: getattr(params, name) for name in ("q", "r", "p0", "x0", "gate", "momentum")}


def _is_even(recording: Recording) -> bool:
    """Whether the samples stand at multiples of the period, within a tenth of it."""
    period = recording.sample_period
    if period is None:
        return True
    return bool(
        np.all(np.abs(recording.time - recording.time[0] - period * np.arange(len(recording))) < 0.1 * period)
    )


def _packed(z: Array) -> dict[str, Any]:
    """Samples as differences of whole multiples of 10^-digits where that is exact, else as they are."""
    for digits in range(MAX_DIGITS):
        steps = _differences(z, 10.0**digits)
        if steps is not None:
            return {"kind": "steps", "digits": digits, "data": _compressed(steps)}
    return {"kind": "doubles", "digits": 0, "data": _compressed(z.astype("<f8"))}


def _differences(z: Array, factor: float) -> NDArray[np.int32] | None:
    """Differences of z * factor from sample to sample, MISSING where there is none; None where digits are lost."""
    there = np.isfinite(z)
    with np.errstate(over="ignore"):
        whole = np.rint(z[there] * factor)
    if not np.array_equal(whole / factor, z[there]) or np.any(np.abs(whole) >= 2.0**30):
        return None
    steps = np.full(len(z), MISSING, dtype="<i4")
    steps[there] = np.diff(whole, prepend=0.0)
    return steps


def _compressed(values: NDArray[Any]) -> str:
    return base64.b64encode(gzip.compress(values.tobytes(), 9, mtime=0)).decode()
