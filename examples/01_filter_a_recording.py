"""Filter a recording.

Opens a sample, filters it at a chosen lag, and prints what the filter does to it.
"""

from __future__ import annotations

import numpy as np

import kalscope


def main() -> None:
    recording = kalscope.open_source("sample:flex_sensor")
    z = recording.channel("flex")

    # You know the lag that you accept, in milliseconds; q and r follow from it and the recording.
    tuned = kalscope.tune(recording, channel="flex", lag_ms=100)
    params, result = tuned.params, tuned.result

    steady = kalscope.steady_state(params, recording.sample_period)
    print(f"q = {params.q:.4g}, r = {params.r:.4g} counts²")
    print(f"lag {steady.lag_samples:.1f} samples, noise reduction {steady.noise_reduction_db:.1f} dB")
    print(f"step between samples: raw {np.std(np.diff(z)):.2f}, filtered {np.std(np.diff(result.x)):.2f} counts")


if __name__ == "__main__":
    main()
