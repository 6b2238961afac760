"""One filter for all devices of a fleet, what each loses by it, which differ from the others or have changed."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.files import atomic_file, write_atomic
from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.text import (
    THIN_SPACE,
    count,
    decibels,
    duration,
    escaped,
    lag_in_full,
    lag_text,
    number,
    percent,
    plural,
    program,
    squared,
    trimmed,
)
from kalscope.errors import BadSetting
from kalscope.estimation.fit import params_for_specification
from kalscope.estimation.pool import (
    FALSE_ALARM,
    WIDTH,
    Changes,
    Losses,
    Outliers,
    Pool,
    PooledFit,
    changes,
    fit_pool,
    losses_of,
    outliers,
    pool_at,
    share_served,
)
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady import steady_state
from kalscope.fleet.read import Question
from kalscope.fleet.run import Tally
from kalscope.fleet.store import (
    DIGESTS,
    FAILED,
    FINISHED,
    LOSS_INPUTS,
    SUMMARY,
    TABLE,
    TIMED_OUT,
    TUNING,
    check_tuning,
    known_digest,
    library,
    loss_rows,
    schema,
    tuning_digest,
)
from kalscope.recording import Recording
from kalscope.tuning.file import dumps, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

WITHIN = 0.1
"""Growth of the prediction error up to which a device counts as served."""
EXPECTED = 0.05
"""Devices that chance alone names as unlike the others, in each quantity: one in twenty fleets."""
CLOCKS = 1e-4
"""Share by which the rates of equal devices may differ: crystals, and stamps with few digits."""
QUANTITIES = {"r": "r", "q": "q", "rate_hz": "sample rate"}
"""The quantities in which devices are compared, and their names for the user."""
MAX_LISTED = 1000
"""Devices of a list in fleet.json; the table has all."""
MAX_REASONS, MAX_NAMED = 5, 5
"""Reasons and devices that are printed; the table and fleet.json have more."""
_YEAR, _MONTH, _DAY = r"(?:19|20)\d\d", r"(?:0[1-9]|1[0-2])", r"(?:0[1-9]|[12]\d|3[01])"
_TIME = r"(?:[T _-]?(?:[01]\d|2[0-3])[-_.:h]?[0-5]\d(?:[-_.:m]?[0-5]\d)?)?"
_DATE = re.compile(rf"(?<!\d)(?:{_YEAR}([-_.]){_MONTH}(?:\1{_DAY}{_TIME})?|{_YEAR}{_MONTH}{_DAY}{_TIME})(?!\d)")
"""2024-05, 2024-05-01, 20240501, each day with or without the time of day."""


@dataclass(frozen=True)
class Devices:
    """The rows of a table, arrays of shape (rows,), NaN where there is nothing."""

    ids: list[str]
    """Name of each recording."""
    channels: list[str]
    """Its channel."""
    units: list[str]
    """Its unit."""
    rate_hz: Array
    """Sample rate, Hz."""
    q: Array
    """Process-noise variance, unit²."""
    r: Array
    """Measurement-noise variance, unit²."""
    q_interval: tuple[Array, Array]
    """The q that each record allows, 95 %, unit²."""
    r_interval: tuple[Array, Array]
    """The r that each record allows."""
    momentum: Array
    """Momentum, sample periods."""
    reasons: Counter[str]
    """Why rows have no q and r, and how many for each reason."""
    loss_inputs: Array | None = None
    """What the fits stored to compute what each loses by a filter for all, shape (rows, WIDTH); None in a finished
    table."""
    failed: int = 0
    """Rows that could not be read or fitted; the verdicts of others without q and r say what is missing."""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def counted(self) -> str:
        """The rows, how many have q and r, and how many failed: all that is shown says it in these words."""
        without = self.reasons.total()
        parts = ((len(self) - without, "with q and r"), (without - self.failed, "without"), (self.failed, "failed"))
        texts = ", ".join(f"{count(n)} {what}" for n, what in parts if n)
        return f"{count(len(self))} {'row' if len(self) == 1 else 'rows'}: {texts}"

    @property
    def usable(self) -> Mask:
        """Where q and r are both above 0."""
        return (self.q > 0.0) & (self.r > 0.0)

    @cached_property
    def channel(self) -> str:
        """The most common channel of those with q and r, "signal" without any."""
        return self._usual(self.channels) or "signal"

    @cached_property
    def unit(self) -> str:
        """Their most common unit."""
        return self._usual(self.units)

    @property
    def sample_period(self) -> float | None:
        """The median sample period of those with q and r, s; None where none is known."""
        known = self.rate_hz[self.usable & np.isfinite(self.rate_hz)]
        return 1.0 / float(np.median(known)) if len(known) else None

    @property
    def rates_differ(self) -> bool:
        """Whether some rates differ by more than a tenth from the median: one q per sample does not suit them."""
        known = self.rate_hz[self.usable & np.isfinite(self.rate_hz)]
        return bool(len(known)) and bool(np.any(np.abs(known / np.median(known) - 1.0) > 0.1))

    def losses(self, params: FilterParams) -> Losses:
        """What each loses by a filter for all."""
        nothing = np.full((len(self), WIDTH), np.nan)
        return losses_of(nothing if self.loss_inputs is None else self.loss_inputs, params)

    def logs(self, name: str) -> tuple[Array, tuple[Array, Array]]:
        """Ln of one of QUANTITIES, NaN where there is none, and its interval, unbounded where it is not known."""
        values: Array = getattr(self, name)
        known = self.usable & (values > 0.0)
        logs = np.log(np.where(known, values, np.nan))
        if name == "rate_hz":
            return logs, (logs - CLOCKS, logs + CLOCKS)
        low, high = (
            np.log(np.where(known & (end > 0.0), end, np.nan))
            for end in (self.q_interval if name == "q" else self.r_interval)
        )
        below = np.where(np.isnan(low), -np.inf, np.minimum(low, logs))
        return logs, (below, np.where(np.isnan(high), np.inf, np.maximum(high, logs)))

    def outliers(self, name: str) -> Outliers:
        """Which devices differ from the others in one of QUANTITIES."""
        return outliers(*self.logs(name), EXPECTED)

    def name(self, i: int) -> str:
        """The recording, with its channel where that is not the usual one."""
        return self.ids[i] if self.channels[i] == self.channel else f"{self.ids[i]} {self.channels[i]}"

    def _usual(self, texts: list[str]) -> str:
        common = Counter(text for text, usable in zip(texts, self.usable, strict=True) if usable).most_common(1)
        return common[0][0] if common else ""


def devices_of(table: Any) -> Devices:
    """A pyarrow Table with the columns of a fleet as arrays."""

    def numbers(name: str) -> Array:
        return np.asarray(table[name].to_numpy(), dtype=np.float64)

    return Devices(
        ids=table["id"].to_pylist(),
        channels=table["channel"].to_pylist(),
        units=table["unit"].to_pylist(),
        rate_hz=numbers("rate_hz"),
        q=numbers("q"),
        r=numbers("r"),
        q_interval=(numbers("q_low"), numbers("q_high")),
        r_interval=(numbers("r_low"), numbers("r_high")),
        momentum=numbers("momentum"),
        reasons=Counter(reason for reason in table["reason"].to_pylist() if reason),
        loss_inputs=loss_rows(table[LOSS_INPUTS].to_pylist()) if LOSS_INPUTS in table.column_names else None,
        failed=sum(verdict in (FAILED, TIMED_OUT) for verdict in table["verdict"].to_pylist()),
    )


@dataclass(frozen=True)
class OverTime:
    """Which devices have changed in one quantity.

    Recordings whose names differ only in a date are of one device: dev7/2024-05-01.csv and dev7/2024-06-01.csv, or
    dev7_20240501T0800 and dev7_20240502T0800.
    """

    rows: Indices
    """The rows of the table whose names hold a date."""
    changes: Changes
    """The changes; its files are indices into `rows`."""

    def name(self, device: int) -> str:
        """The device: its names without the date and the kind of file."""
        name = re.sub(r"\.\w{1,8}$", "", str(self.changes.device[device]).split("\n")[0])
        return re.sub(r"/+", "/", name).strip("/-_. ") or "one device"

    def since(self, device: int) -> int:
        """The row of the table from which on a device has changed."""
        return int(self.rows[self.changes.step_at[device]])

    def factor(self, device: int) -> float:
        """How many times as large the quantity has become."""
        return float(np.exp(self.changes.step[device]))


def split_date(name: str) -> tuple[str, str] | None:
    """The name of the device and the digits of the date of a recording; None without a date."""
    dates = list(_DATE.finditer(name))
    if not dates:
        return None
    last = dates[-1]  # a folder of the year may come before
    return name[: last.start()] + name[last.end() :], re.sub(r"\D", "", last.group()).ljust(14, "0")


def over_time(devices: Devices, quantity: str) -> OverTime | None:
    """Which devices have changed in q or r; None where no device has two recordings."""
    logs, (low, high) = devices.logs(quantity)
    dated = [
        (i, f"{part[0]}\n{devices.channels[i]}", part[1])
        for i in np.flatnonzero(np.isfinite(logs)).tolist()
        if (part := split_date(devices.ids[i])) is not None
    ]
    if len({name for _, name, _ in dated}) == len(dated):
        return None
    rows, names, dates = (list(column) for column in zip(*dated, strict=True))
    places = np.array(rows, np.intp)
    interval = low[places], high[places]
    return OverTime(places, changes(logs[places], interval, np.array(names, dtype=object), np.array(dates)))


@dataclass(frozen=True)
class Shared:
    """One filter for all."""

    fit: PooledFit
    """The most likely one, or the one that meets the goal."""
    params: FilterParams
    """The filter itself."""
    how: str
    """How it was chosen, in a few words, for the tuning file."""
    losses: Losses
    """What each device loses by it, NaN for one that could not be judged."""

    @property
    def judged(self) -> int:
        """How many devices could be judged."""
        return int(np.isfinite(self.losses.error).sum())

    @property
    def served(self) -> float:
        """Share of the judged devices whose prediction error grows by at most WITHIN, 0 … 1."""
        return share_served(self.losses.error, WITHIN)

    @property
    def not_served(self) -> list[int]:
        """The others, the worst first."""
        beyond = np.flatnonzero(self.losses.error > WITHIN)
        return beyond[np.argsort(-self.losses.error[beyond], kind="stable")].tolist()

    @property
    def columns(self) -> dict[str, Array]:
        """What each device loses, by its name in the table and in fleet.json."""
        one = self.losses
        return {"lag_loss_samples": one.lag_samples, "noise_loss_db": one.noise_db, "error_growth": one.error}


@dataclass(frozen=True)
class Answer:
    """The answer for a fleet."""

    devices: Devices
    """The table."""
    shared: Shared | None
    """One filter for all; None where there is none, and `refusal` says why."""
    refusal: str
    """Why there is no such filter; "" where there is one."""
    outliers: dict[str, Outliers]
    """Which devices differ from the others in each of QUANTITIES."""
    changed: dict[str, OverTime]
    """Which devices have changed in r and q, where a device has several recordings."""


def answer_for(devices: Devices, pool: Pool, question: Question) -> Answer:
    """The answer for a fleet.

    Args:
        devices: Its table.
        pool: What all recordings contribute to one filter without momentum.
        question: What was estimated of each recording; a goal holds for the filter of all too.
    """
    shared, refusal = None, ""
    try:
        shared = _shared(devices, pool, question)
    except BadSetting as error:
        refusal = str(error)
    changed = {name: one for name in ("r", "q") if (one := over_time(devices, name)) is not None}
    return Answer(devices, shared, refusal, {name: devices.outliers(name) for name in QUANTITIES}, changed)


def _shared(devices: Devices, pool: Pool, question: Question) -> Shared:
    period, momentum = devices.sample_period, 0.0
    request = question.request(Recording(np.arange(3.0) * (period or 1.0), ("",), ("",), np.zeros((3, 1)), period))
    if request.target:
        tau = request.checked_momentum() or 0.0
        wanted = params_for_specification(
            1.0, **request.target, sample_period=period, momentum=tau, overshoot=request.overshoot
        )
        fit, how, momentum = pool_at(pool, wanted.ratio), request.goal, wanted.momentum
    elif request.ratio is not None:
        fit, how = pool_at(pool, request.ratio), f"q/r = {request.ratio:g}"
    else:
        fit, how = fit_pool(pool), "pooled maximum likelihood"
    if fit.params is None:
        got = "r = 0" if fit.q > 0.0 else "q = 0"
        raise BadSetting(f"q and r of all must both be above 0 (got {got}): a goal such as --lag-ms 50 gives both")
    params = FilterParams(fit.q, fit.r, momentum=momentum)
    return Shared(fit, params, how, devices.losses(params))


def save_answer(answer: Answer, table: Any, folder: Path) -> None:
    """Write the table with what each device loses, fleet.json for programs and the tuning of the filter for all.

    Each is written whole or not at all. Without a filter for all there is no tuning file.

    Raises:
        OSError: The folder cannot be written; the files are unchanged.
        BadSetting: there is a tuning file that no fleet wrote; the files are unchanged.
    """
    pa, shared = library("pyarrow"), answer.shared
    if shared is not None:
        check_tuning(folder)
        for name, values in shared.columns.items():
            column = pa.array(values, pa.float64(), mask=~np.isfinite(values))
            table = table.set_column(table.column_names.index(name), name, column)
    with atomic_file(folder / TABLE) as file:
        library("pyarrow.parquet").write_table(
            table.select(FINISHED).cast(schema(FINISHED)), file, compression="zstd"
        )
    before, tuning = known_digest(folder), None if shared is None else tuning_of(answer.devices, shared)
    digests = [one for one in (before, tuning and tuning_digest(dumps(tuning))) if one]
    plain = as_plain(answer) | {DIGESTS: digests}  # first: a run that is killed here recognizes both files
    text = escaped(json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False))
    write_atomic(folder / SUMMARY, (text + "\n").encode("utf-8", "replace"))
    if tuning is not None:
        save_tuning(tuning, folder / TUNING)
    elif before is not None:
        (folder / TUNING).unlink()


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

    def listed(rows: Sequence[int] | Indices, values: dict[str, Array]) -> list[dict[str, Any]]:
        return [
            {"id": devices.ids[i], "channel": devices.channels[i]}
            | {name: _finite(float(column[i])) for name, column in values.items()}
            for i in map(int, rows[:MAX_LISTED])
        ]

    def changed(one: OverTime) -> list[dict[str, Any]]:
        return [
            {
                "device": one.name(i),
                "recordings": int(one.changes.files[i]),
                "since": devices.ids[one.since(i)],
                "factor": _finite(one.factor(i)),
                "p": float(one.changes.adjusted_p[i]),
            }
            for i in map(int, one.changes.changed[:MAX_LISTED])
        ]

    shared = answer.shared
    return {
        "tool": program(),
        "rows": len(devices),
        "usable": int(devices.usable.sum()),
        "failed": devices.failed,
        "reasons": dict(devices.reasons.most_common(MAX_LISTED)),
        "channel": devices.channel,
        "unit": devices.unit,
        "sample_period": devices.sample_period,
        "one_filter": None
        if shared is None
        else _plain_filter(shared, devices.sample_period)
        | {"not_served": listed(shared.not_served, shared.columns)},
        "why_not": answer.refusal or None,
        "unlike": {
            name: {
                "expected_by_chance": one.expected,
                "middle": None if math.isnan(one.middle) else math.exp(one.middle),
                "devices": listed(one.devices, {name: getattr(devices, name), "z": one.z}),
            }
            for name, one in answer.outliers.items()
        },
        "changed": {
            name: {"false_alarm": FALSE_ALARM, "devices": changed(one)} for name, one in answer.changed.items()
        },
    }


def _plain_filter(shared: Shared, period: float | None) -> dict[str, Any]:
    settled = steady_state(shared.params, period)
    spreads: dict[str, dict[str, float] | None] = {}
    for name, values in shared.columns.items():
        spread = _spread(values)
        spreads[name] = None if spread is None else dict(zip(("p5", "median", "p95"), spread, strict=True))
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
        "lost": spreads,
    }


def _spread(values: Array) -> list[float] | None:
    """The ends of the middle 90 % of the devices, and between them the median; None where none is judged."""
    known = values[np.isfinite(values)]
    return np.percentile(known, (5.0, 50.0, 95.0)).tolist() if len(known) else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def summary(answer: Answer, tally: Tally, folder: Path) -> str:
    """How many rows, how many without q and r and why, one filter for all, the devices that differ, the files."""
    done = "nothing was missing"
    if tally.done:
        speed = (
            f" in {duration(tally.seconds)}, {number(tally.rows / tally.seconds)} rows/s" if tally.seconds else ""
        )
        done = f"{count(tally.done)} of {count(tally.units)} files or row groups done{speed}"
    files = [f"Table: {folder / TABLE}"] + ([f"tuning: {folder / TUNING}"] if answer.shared else [])
    lines = [f"{answer.devices.counted}; {done}", *_lines(answer), "; ".join(files)]
    # Names come from files, and might move the cursor of a terminal.
    return "".join("".join(c if c.isprintable() or c == THIN_SPACE else " " for c in line) + "\n" for line in lines)


def _lines(answer: Answer) -> Iterator[str]:
    devices = answer.devices
    if devices.reasons:
        common = devices.reasons.most_common(MAX_REASONS)
        yield "Why not all have q and r:"
        yield from (f"  {count(times)} × {reason}" for reason, times in common)
        others = devices.reasons.total() - sum(times for _, times in common)
        if others:
            yield f"  {count(others)} for other reasons"
    if answer.shared is None:
        yield f"No filter for all: {answer.refusal}"
    else:
        yield from _filter_lines(devices, answer.shared)
    if devices.usable.any() and not any(len(one.devices) for one in answer.outliers.values()):
        yield "No device is unlike the others in r, q or sample rate"
    for quantity, one in answer.outliers.items():
        if len(one.devices):
            values, middle = getattr(devices, quantity), math.exp(one.middle)
            named = _named(
                [f"{devices.name(i)} ({number(values[i] / middle)} ×)" for i in one.devices[:MAX_NAMED]],
                one.devices,
            )
            chance = trimmed(one.expected)
            yield f"Unlike the others in {QUANTITIES[quantity]}, {chance} expected by chance: {named}"
    for quantity, one in answer.changed.items():
        named = _named(
            [
                f"{one.name(i)} ({number(one.factor(i))} × from {devices.name(one.since(i))} on)"
                for i in map(int, one.changes.changed[:MAX_NAMED])
            ],
            one.changes.changed,
        )
        several = plural(int((one.changes.files > 1).sum()), "device")
        yield f"Changed in {quantity}, of {several} with several recordings: {named or 'none'}"


def _filter_lines(devices: Devices, shared: Shared) -> Iterator[str]:
    """The filter for all, how many devices it suits, and what it costs them."""
    period, losses = devices.sample_period, shared.losses
    q, r = trimmed(shared.params.q, 4), trimmed(float(shared.params.r), 4)
    settled = steady_state(shared.params, period)
    lag, noise = lag_in_full(settled.lag_samples, period), decibels(-settled.noise_reduction_db)
    yield f"One filter for all: q = {q}, r = {r} {squared(devices.unit)}, lag {lag}, noise {noise} ({shared.how})"
    if shared.judged:
        worst = _named(
            [f"{devices.name(i)} ({_loss_text(devices, losses, i)})" for i in shared.not_served[:MAX_NAMED]],
            shared.not_served,
        )
        yield (
            f"  for {percent(shared.served)} of {count(shared.judged)} its prediction error on unseen samples is "
            f"at most {percent(WITHIN)} above that of the device's own filter{worst and f'; not {worst}'}"
        )
        usual = [
            f"{name} {_signed(text(spread[0]))} to {_signed(text(spread[2]))}"
            for name, values, text in (
                ("error", losses.error, percent),
                ("lag", losses.lag_samples, partial(lag_text, period=period)),
                ("noise", losses.noise_db, decibels),
            )
            if (spread := _spread(values)) is not None
        ]
        yield f"  nine of ten devices, against their own filters: {', '.join(usual)}"
    elif shared.params.momentum > 0.0:
        yield "  what each device loses is only tried without momentum"
    if devices.rates_differ:
        yield f"  the sample rates differ: q holds for {duration(period)} a sample"


def _loss_text(devices: Devices, losses: Losses, i: int) -> str:
    """What one device loses."""
    period = 1.0 / float(devices.rate_hz[i]) if devices.rate_hz[i] > 0.0 else None
    lag, noise = float(losses.lag_samples[i]), float(losses.noise_db[i])
    parts = [f"error {_signed(percent(float(losses.error[i])))}"]
    parts += [f"lag {_signed(lag_text(lag, period))}"] if math.isfinite(lag) else []
    parts += [f"noise {_signed(decibels(noise))}"] if math.isfinite(noise) else []
    return ", ".join(parts)


def _signed(text: str) -> str:
    return text if text.startswith(("−", "-")) else f"+{text}"


def _named(texts: Sequence[str], rows: Sequence[int] | Indices) -> str:
    """The texts of the first of these rows, and how many more there are."""
    return ", ".join(texts) + (f" and {count(len(rows) - MAX_NAMED)} more" if len(rows) > MAX_NAMED else "")
