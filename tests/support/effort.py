"""How much random tests try: little in the ordinary run, `KALSCOPE_FUZZ` times as much or more in `make soak`."""

from __future__ import annotations

import os

FUZZ = int(os.environ.get("KALSCOPE_FUZZ", "1"))
EXAMPLES = 20 if FUZZ == 1 else 50 * FUZZ
"""Examples of a Hypothesis test that names no number of its own."""
