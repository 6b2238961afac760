"""Lines that name their values: name:value, key=value, JSON, and their right reading."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from random import Random

import numpy as np
from tests.sources.dialects.stamps import Stamps
from tests.sources.dialects.tables import NAMES, Case, finish

STEPS = (20, 50, 100, 1000)


def make_labelled(rng: Random) -> Case:
    """A log of named values, with or without time."""
    n, width = rng.randint(30, 120), rng.randint(1, 4)
    style = rng.choice(["colon", "equals", "json"])
    case = Case(names=tuple(rng.sample(NAMES, width)), units=("",) * width)
    texts = [[f"{20 + rng.gauss(0, 4):.2f}" for _ in case.names] for _ in range(n)]
    case.values = np.array([[float(text) for text in row] for row in texts])
    clock = rng.choice(["none", "t", "ms", "date"])
    step = rng.choice(STEPS)
    if clock != "none":
        case.period = step / 1000
        case.stamps = Stamps("even", (), (), np.arange(n) * case.period, case.period)
    between = rng.choice([", ", ",", "\t", " "])
    lines = [line(case, style, clock, between, texts[i], i * step) for i in range(n)]
    finish(rng, case, lines, () if style == "json" else ("comments",))
    return case


def line(case: Case, style: str, clock: str, between: str, texts: list[str], millis: int) -> str:
    """One line; the date of `DATE TIME - name: value` stands before the pairs."""
    date = (datetime(2024, 5, 17, 9, 30) + timedelta(milliseconds=millis)).isoformat(" ", "milliseconds")
    stamp = {"none": [], "t": [("t", f"{millis / 1000:.3f}")], "ms": [("millis", str(millis))], "date": []}[clock]
    pairs = [*stamp, *zip(case.names, texts, strict=True)]
    if style == "json":
        dated = {"timestamp": date.replace(" ", "T")} if clock == "date" else {}
        return json.dumps(dated | {name: float(text) for name, text in pairs})
    mark = "=" if style == "equals" else ":" if between != "\t" else ": "
    body = between.join(f"{name}{mark}{text}" for name, text in pairs)
    return f"{date} - {body}" if clock == "date" else body
