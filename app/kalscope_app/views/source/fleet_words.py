"""The texts in the folder "Fleet" of the Source tab, as markdown; every name of the fleet is escaped. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.text import count, lag_in_full, one_line, percent, plural, squared, trimmed
from kalscope.filtering.steady_state import steady_state
from kalscope_app.session.fleet import OpenFleet, loss_text
from kalscope_app.views.markdown import escape_markdown

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

MAX_NAME = 16
"""Characters of a name in the table."""


def about_fleet(fleet: Fleet) -> str:
    """How many recordings there are, one filter for all, how many devices it suits, and the progress of a run."""
    said = [f"{fleet.devices.counted}."]
    if fleet.done is not None:
        known = "" if fleet.note.units is None else f" of {count(fleet.note.units)}"
        said.append(f"**Not finished: {count(fleet.done)}{known} files or row groups done.**")
    if fleet.shared is not None:
        params, devices = fleet.shared.params, fleet.devices
        lag = lag_in_full(steady_state(params, devices.sample_period).lag_samples, devices.sample_period)
        q, r = trimmed(params.q, 4), trimmed(float(params.r), 4)
        unit = escape_markdown(squared(devices.unit), 20)
        said.append(f"One filter for all: q = {q}, r = {r} {unit}, lag {lag}.")
        judged = int(np.isfinite(fleet.growth).sum())
        if judged:
            said.append(
                f"For {percent(fleet.served)} of {count(judged)} its error on unseen samples is at most 10 % above"
                " that of the device's own filter."
            )
    odd = int(fleet.outlier.sum())
    if odd:
        said.append(f"{plural(odd, 'device')} unlike the others in r or q.")
    return " ".join(said)


def fleet_table(shown: OpenFleet) -> str:
    """The first devices in the chosen order."""
    fleet, rows = shown.fleet, shown.rows
    if not rows:
        return "None."
    devices = fleet.devices
    if not devices.usable[rows].any():
        return "\n".join(
            f"{place}. {_name(fleet, i)}: {escape_markdown(fleet.reasons[i], 120)}"
            for place, i in enumerate(rows, 1)
        )
    lines = ["| | device | q | r | loss |", "|--:|---|--:|--:|--:|"]
    for place, i in enumerate(rows, 1):
        growth = float(fleet.growth[i])
        loss = "–" if math.isnan(growth) else loss_text(growth).replace(" ", "\u00a0")
        name = f"**{_name(fleet, i)}**" if fleet.outlier[i] else _name(fleet, i)
        lines.append(f"| {place} | {name} | {_variance(devices.q[i])} | {_variance(devices.r[i])} | {loss} |")
    return "\n".join(lines)


def device_labels(shown: OpenFleet) -> dict[str, int]:
    """The devices of the table as a menu names them: their place and name, and the row of each."""
    fleet = shown.fleet
    return {f"{place}. {one_line(fleet.devices.name(i))[-60:]}": i for place, i in enumerate(shown.rows, 1)}


def _name(fleet: Fleet, i: int) -> str:
    """The end of a name, which tells devices apart."""
    name = one_line(fleet.devices.name(i))
    return escape_markdown(name if len(name) <= MAX_NAME else f"…{name[1 - MAX_NAME :]}", MAX_NAME)


def _variance(value: float) -> str:
    return "–" if math.isnan(value) else trimmed(float(value))
