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
    filter->rejected = 0;
}

kalscope_real kalscope_update(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    const kalscope_real before = filter->p;
    const kalscope_real predicted = before + tuning->q;
    const kalscope_real s = predicted + tuning->r;

    filter->p = predicted;
    filter->k = 0;
    if (isnan(z)) return filter->x;
    if (isinf(predicted)) { /* nothing was known: believe the first sample */
        filter->k = 1;
        filter->p = tuning->r;
        filter->x = z;
    } else if (isnan(filter->x)) { /* p0 is known, the first sample is the start */
        filter->k = s > 0 ? predicted / s : 0;
        filter->p = (1 - filter->k) * predicted;
        filter->x = z;
    } else if (s > 0) {
        const kalscope_real v = z - filter->x;
        if (tuning->gate > 0 && v * v > tuning->gate * s && filter->rejected < MOST_REJECTED) {
            filter->rejected++;
            return filter->x;
        }
        filter->k = predicted / s;
        filter->p = (1 - filter->k) * predicted;
        if (tuning->settled_gain > 0 && filter->p == before) filter->k = tuning->settled_gain;
        filter->x = filter->x + filter->k * v;
    } else {
        return filter->x; /* the estimate and the sample both claim to be exact: keep the estimate */
    }
    filter->rejected = 0;
    return filter->x;
}
