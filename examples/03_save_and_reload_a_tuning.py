"""Save a tuning and use it again.

The tuning file holds q, r and the start of every channel, with the recording they were found on.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import kalscope


def main() -> None:
    recording = kalscope.open_source("sample:nile")
    tuning = kalscope.Tuning(
        channels=(kalscope.ChannelTuning("volume", recording.units[0], q=1469.1, r=15099.0, how="textbook"),),
        source=recording.source,
        sample_period=recording.sample_period,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tuning.toml"
        kalscope.save_tuning(tuning, path)
        print(path.read_text())
        again = kalscope.load_tuning(path)
    result = kalscope.kalman_filter(recording.channel("volume"), again.channel("volume").params)
    print(f"log-likelihood {result.loglik:.4f} (published: -632.5456 at the optimum)")


if __name__ == "__main__":
    main()
