"""Is there a simpler filter? The classic ones, each tuned to the lag or the noise reduction of the present q and r.

The steady Kalman filter of this model is exponential smoothing with α = K, no more and no less; what it adds is
the start-up, the gaps, and that K follows from two variances. The comparison says so, with numbers.
"""

from __future__ import annotations

from kalscope.analysis.alternatives.comparison import Alternative, Comparison, compare_alternatives
from kalscope.analysis.alternatives.verdict import Difference

__all__ = ["Alternative", "Comparison", "Difference", "compare_alternatives"]
