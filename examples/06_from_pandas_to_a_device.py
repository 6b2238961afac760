"""Eight snippets, as in a notebook: samples in, a tuned filter, a table, a file and code for a device out."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import kalscope


def main() -> None:
    # 1. A recording, and one channel of it.
    recording = kalscope.open_source("sample:flex_sensor")
    z = recording["flex"]
    print(recording)

    # 2. One call: the best fit, or the filter with a lag that you accept.
    print(kalscope.tune(z))
    tuned = kalscope.tune(z, lag_ms=50, sample_period=recording.sample_period)
    print(tuned, tuned.message, sep="\n")

    # 3. A Series keeps its index, which gives the sample period.
    index = pd.to_timedelta(recording.time, unit="s")
    series = pd.Series(z, index=index, name="flex")
    again = kalscope.tune(series, lag_ms=50)
    print(f"filtered Series with the same index: {again.x.index.equals(index)}")

    # 4. A table of raw, filtered and variance.
    print(tuned.to_frame().describe().round(2))

    # 5. A filter with values of your choice.
    x = kalscope.denoise(series, q=tuned.params.q, r=float(tuned.params.r))
    print(f"{type(x).__name__} of {len(x)} values, {np.std(np.diff(x)):.2f} counts from one to the next")

    # 6. What you know already: the noise, or the ratio.
    print(f"q = {kalscope.estimate(z, r=4.0).q:.4g} for r = 4")
    print(f"r = {kalscope.estimate(z, ratio=0.1).r:.4g} for q/r = 0.1")

    # 7. Does it fit?
    fit = kalscope.diagnose(tuned.result)
    assert not isinstance(fit, tuple)  # as it is of several sensors
    print(fit.advice)

    # 8. A tuning file, and code for a board.
    with tempfile.TemporaryDirectory() as folder:
        tuned.save(Path(folder) / "tuning.toml")
        print(*(path.name for path in tuned.export("arduino", Path(folder) / "kalscope_filter")))


if __name__ == "__main__":
    main()
