$about

#include "kalscope_filter.h"

#include <math.h>

/* A fused x + k * v is rounded once instead of twice: other last bits than Kalscope shows. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

enum { MOST_REJECTED = $gate_limit }; /* in a row; the next sample is taken, so that a gate cannot lock out */

$tunings
void kalscope_start(kalscope_filter *filter, const kalscope_tuning *tuning)
{
    filter->tuning = *tuning;
    filter->x = tuning->x0;
    filter->p = tuning->p0;
    filter->k = 0;
@momentum     filter->velocity = 0;
@momentum     filter->g = 0;
@momentum     filter->w = tuning->w0;
    filter->rejected = 0;
}
@momentum 
@momentum /* What a sample tells of the velocity: its gain, by which the variance w and the covariance g shrink. */
@momentum static kalscope_real velocity_gain(kalscope_filter *filter, kalscope_real s)
@momentum {
@momentum     const kalscope_real gain = filter->g / s;
@momentum     filter->w = filter->w - gain * filter->g;
@momentum     filter->g = (1 - filter->k) * filter->g;
@momentum     return gain;
@momentum }

kalscope_real kalscope_update(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    const kalscope_real before = filter->p;
@plain     const kalscope_real predicted = before + tuning->q;
@momentum     const kalscope_real carried = tuning->f * filter->w;
@momentum     const kalscope_real predicted = before + tuning->f * (2 * filter->g + carried) + tuning->q11;
    const kalscope_real s = predicted + tuning->r;

    filter->p = predicted;
@momentum     filter->g = tuning->e * (filter->g + carried) + tuning->q12;
@momentum     filter->w = tuning->e * tuning->e * filter->w + tuning->q22;
@momentum     filter->x = filter->x + tuning->f * filter->velocity;
@momentum     filter->velocity = tuning->e * filter->velocity;
    filter->k = 0;
    if (isnan(z)) return filter->x;
    if (isinf(predicted)) { /* nothing was known: believe the first sample */
        filter->k = 1;
        filter->p = tuning->r;
@momentum         filter->g = 0;
        filter->x = z;
    } else if (isnan(filter->x)) { /* p0 is known, the first sample is the start */
        filter->k = s > 0 ? predicted / s : 0;
        filter->p = (1 - filter->k) * predicted;
@momentum         if (s > 0) velocity_gain(filter, s);
        filter->x = z;
    } else if (s > 0) {
        const kalscope_real v = z - filter->x;
        if (tuning->gate > 0 && v * v > tuning->gate * s && filter->rejected < MOST_REJECTED) {
            filter->rejected++;
            return filter->x;
        }
        filter->k = predicted / s;
        filter->p = (1 - filter->k) * predicted;
@momentum         filter->velocity = filter->velocity + velocity_gain(filter, s) * v;
        if (tuning->settled_gain > 0 && filter->p == before) filter->k = tuning->settled_gain;
        filter->x = filter->x + filter->k * v;
    } else {
        return filter->x; /* the estimate and the sample both claim to be exact: keep the estimate */
    }
    filter->rejected = 0;
    return filter->x;
}
