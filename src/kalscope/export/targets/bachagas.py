"""bachagas/Kalman.h: the same five lines, so its constructor takes our numbers as they are.

Its own code knows neither missing samples nor an automatic start nor a gate; a short function around it does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.export.header_text import about, about_channel, commented
from kalscope.export.names import number_text

if TYPE_CHECKING:
    from kalscope.export.job import ExportJob
    from kalscope.tuning.tuning import ChannelTuning

_HEADER = """\
{about}//
// For Kalman.h of bachagas: kalman_init(q, r, p, initial value), then kalman_update, the same formula.
// By itself that library lets one NaN spoil all that follows and starts at the value it is given;
// kalscope_update() below adds missing samples (predict only), the start and the gate.
// Call x = kalscope_update(&kalscope_filter_NAME, z) once a sample. On an AVR board double is float32.
#ifndef KALSCOPE_BACHAGAS_H
#define KALSCOPE_BACHAGAS_H

#include <math.h>
#include "Kalman.h"

typedef struct {{
  kalman_state state;
  double gate;  // on v^2/s
  int refused;  // samples in a row that the gate did not let through
}} kalscope_channel;

static inline double kalscope_update(kalscope_channel *f, double z) {{
  kalman_state *s = &f->state;
  s->k = 0.0;
  if (isnan(z)) {{
    s->p = s->p + s->q;
    return s->x;
  }}
  if (isinf(s->p)) {{  // the first sample of an unknown start
    s->x = z;
    s->p = s->r;
    s->k = 1.0;
    f->refused = 0;
    return z;
  }}
  if (isnan(s->x)) s->x = z;
  double v = z - s->x;
  if (v * v > f->gate * (s->p + s->q + s->r) && f->refused < 5) {{
    s->p = s->p + s->q;
    f->refused = f->refused + 1;
    return s->x;
  }}
  f->refused = 0;
  kalman_update(s, z);
  return s->x;
}}

{channels}
#endif
"""


def files(job: ExportJob) -> dict[str, str]:
    """`kalscope_bachagas.h`, C++ as the Arduino compiles it."""
    channels = "\n".join(_channel(job, *pair) for pair in zip(job.identifiers, job.channels, strict=True))
    return {"kalscope_bachagas.h": _HEADER.format(about=commented(about(job), "//"), channels=channels)}


def _channel(job: ExportJob, word: str, channel: ChannelTuning) -> str:
    p0 = "INFINITY" if channel.p0 is None else number_text(channel.p0)
    x0 = "NAN" if channel.x0 is None else number_text(channel.x0)
    gate = "INFINITY" if channel.gate is None else number_text(channel.gate)
    init = f"kalman_init({number_text(channel.q)}, {number_text(channel.r)}, {p0}, {x0})"
    return (
        commented(about_channel(job, channel), "//")
        + f"static kalscope_channel kalscope_filter_{word} = {{{init}, {gate}, 0}};\n"
    )
