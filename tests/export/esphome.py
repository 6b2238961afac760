"""What ESPHome's combination component computes, stated again in float32."""

from __future__ import annotations

import math

import numpy as np


def esphome(sensors, z):
    """Its answers to readings, shape (n, sources): those of a row come one after the other, a row every 10 ms.

    The last of `sensors` is the Kalman filter; the others are scaled copies of its sources.
    """
    f, copies = np.float32, {one["source_id"]: one["filters"] for one in sensors[:-1]}
    sources = [
        (f(one["error"]), copies.get(one["source"].removesuffix("_scaled"))) for one in sensors[-1]["sources"]
    ]
    per_row = f(sensors[-1]["process_std_dev"]) * f(sensors[-1]["process_std_dev"]) * f(0.001) * f(10)
    x, p, answers = f(math.nan), f(math.inf), []
    for row in z:
        waited = False
        for value, (error, filters) in zip(map(f, row), sources, strict=True):
            if math.isnan(value):
                continue
            if filters:
                value = (value + f(filters[0]["offset"])) * f(filters[1]["multiply"])  # noqa: PLW2901
            r = error * error
            if math.isnan(x):
                x, p, waited = value, r, True
                continue
            p, waited = p if waited else p + per_row, True
            first, second, a, b = (x, value, p, r) if p < r else (value, x, r, p)
            x, p = first + a * (second - first) / (a + b), a - a * a / (a + b)
        if not waited and not math.isnan(x):
            p = p + per_row
        answers.append(x)
    return np.array(answers, dtype=np.float64)
