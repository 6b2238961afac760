$about//
// For Kalman.h of bachagas: kalman_init(q, r, p, initial value), then kalman_update, the same formula.
// By itself that library turns everything after one NaN into NaN, and starts at the value it is given;
// kalscope_update() below adds missing samples (predict only), the start and the gate.
// Call x = kalscope_update(&kalscope_filter_NAME, z) once a sample. On an AVR board double is float32.
#ifndef KALSCOPE_BACHAGAS_H
#define KALSCOPE_BACHAGAS_H

#include <math.h>
#include "Kalman.h"

typedef struct {
  kalman_state state;
  double gate;  // on v^2/s
  int refused;  // samples in a row that the gate rejected
} kalscope_channel;

static inline double kalscope_update(kalscope_channel *f, double z) {
  kalman_state *s = &f->state;
  s->k = 0.0;
  if (isnan(z)) {
    s->p = s->p + s->q;
    return s->x;
  }
  if (isinf(s->p)) {  // the first sample of an unknown start
    s->x = z;
    s->p = s->r;
    s->k = 1.0;
    f->refused = 0;
    return z;
  }
  if (isnan(s->x)) s->x = z;
  double v = z - s->x;
  if (v * v > f->gate * (s->p + s->q + s->r) && f->refused < 5) {
    s->p = s->p + s->q;
    f->refused = f->refused + 1;
    return s->x;
  }
  f->refused = 0;
  kalman_update(s, z);
  return s->x;
}

$channels
#endif
