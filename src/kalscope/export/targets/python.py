"""Python: a small class that needs nothing but the language, and the call of Kalscope in a second file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.export.header_text import about, about_channel, commented
from kalscope.export.names import number_text

if TYPE_CHECKING:
    from kalscope.export.job import ExportJob
    from kalscope.tuning.tuning import ChannelTuning

# The encoding line that a hostile name could form is read in the first two lines only: they are constants.
_CLASS = '''\
"""The scalar Kalman noise filter as it was tuned; needs nothing but Python 3."""

{about}
from math import inf, isinf, isnan, nan


class KalmanFilter:
    def __init__(self, q, r, p0=inf, x0=nan, gate=inf):
        self.q, self.r, self.p, self.x, self.gate = q, r, p0, x0, gate
        self.k, self.refused = 0.0, 0

    def update(self, z):
        """The filtered value after the sample z; NaN is a missing sample: predict only."""
        self.p, self.k = self.p + self.q, 0.0
        if isnan(z):
            return self.x
        if isinf(self.p):  # the first sample of an unknown start
            self.x, self.p, self.k, self.refused = z, self.r, 1.0, 0
            return z
        v, s = z - self.x, self.p + self.r
        if v * v > self.gate * s and self.refused < 5:
            self.refused += 1
            return self.x
        self.k, self.refused = self.p / s, 0
        self.x = z if isnan(self.x) else self.x + self.k * v
        self.p = (1.0 - self.k) * self.p
        return self.x


FILTERS = {{
{filters}}}
'''

_CALL = '''\
"""The same filters by Kalscope itself, fast on whole recordings: pip install kalscope."""

{about}
import kalscope

PARAMS = {{
{filters}}}


def denoise(name, samples):
    """The filtered signal of one channel; NaN is a missing sample."""
    return kalscope.denoise(samples, PARAMS[name])
'''


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_filter.py` and `with_kalscope.py`."""
    head = commented(about(job), "#")
    return {
        "kalscope_filter.py": _CLASS.format(about=head, filters=_entries(job, "KalmanFilter")),
        "with_kalscope.py": _CALL.format(about=head, filters=_entries(job, "kalscope.FilterParams")),
    }


def _entries(job: ExportJob, maker: str) -> str:
    return "".join(
        commented(about_channel(job, channel), "    #") + f'    "{word}": {maker}({_arguments(channel)}),\n'
        for word, channel in zip(job.identifiers, job.channels, strict=True)
    )


def _arguments(channel: ChannelTuning) -> str:
    """The numbers that the tuning gives; a start or a gate that is left out is the automatic one in both."""
    names = ("q", "r", "p0", "x0", "gate")
    values = ((name, getattr(channel, name)) for name in names)
    return ", ".join(f"{name}={number_text(value)}" for name, value in values if value is not None)
