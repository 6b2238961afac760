"""Filter a recording.

Opens a sample, filters it at a chosen lag, and prints what the filter does to it.
"""

from __future__ import annotations

import numpy as np

import kalscope


def main() -> None:
    recording = kalscope.open_source("sample:flex_sensor")
    z = recording.channel("flex")

    # You know a lag in milliseconds and a noise level in your own unit; q follows from both.
    r = float(kalscope.starting_params(z).r)
    ratio = kalscope.ratio_for(lag_s=0.100, sample_period=recording.sample_period)
    params = kalscope.FilterParams(q=ratio * r, r=r)

    result = kalscope.kalman_filter(z, params)
    steady = kalscope.steady_state(params, recording.sample_period)
    print(f"q = {params.q:.4g}, r = {params.r:.4g} counts²")
    print(f"lag {steady.lag_samples:.1f} samples, noise reduction {steady.noise_reduction_db:.1f} dB")
    print(f"step between samples: raw {np.std(np.diff(z)):.2f}, filtered {np.std(np.diff(result.x)):.2f} counts")


if __name__ == "__main__":
    main()
