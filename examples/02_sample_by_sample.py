"""Filter sample by sample, as a device does.

The streaming filter equals the batch filter bit for bit; a missing sample is NaN.
"""

from __future__ import annotations

import math

import kalscope


def main() -> None:
    stream = kalscope.KalmanFilter(kalscope.FilterParams(q=0.01, r=1.0))
    readings = [20.1, 20.9, math.nan, 19.8, 20.3]
    filtered = [stream.update(reading) for reading in readings]
    for reading, x in zip(readings, filtered, strict=True):
        print(f"raw {reading:6.2f}   filtered {x:6.3f}")
    batch = kalscope.kalman_filter(readings, kalscope.FilterParams(q=0.01, r=1.0))
    print("equal to the batch filter:", batch.x.tolist() == filtered)


if __name__ == "__main__":
    main()
