$about

/*
 * The settled filter with gains that never change, for samples at a regular period:
 *
 *   kalscope_fixed filter = KALSCOPE_FIXED_$first;
 *   filtered = kalscope_fixed_update(&filter, raw);
 *
 * It is the tuned filter once that has settled. Until then it follows more slowly, since it weighs the first samples
 * as all others; after missing samples, NAN, it does not catch up faster. There is no outlier gate.
@plain  * C99 and C++, one multiplication a sample, no heap. Never compile it with -ffast-math: NAN would be lost.
@momentum  * C99 and C++, three multiplications a sample, no heap. Never compile it with -ffast-math: NAN would be lost.
 */
#ifndef KALSCOPE_SETTLED_H
#define KALSCOPE_SETTLED_H

#include <math.h>

/* A fused x + k * v is rounded once instead of twice: other last bits than Kalscope shows. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__AVR__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

$real
typedef struct {
    kalscope_fixed_real k;    /* share of each innovation that is added to x */
@momentum     kalscope_fixed_real l;    /* share that is added to the step */
@momentum     kalscope_fixed_real e;    /* share of the step that is left after a sample */
    kalscope_fixed_real x;    /* filtered value; NAN: the first sample */
@momentum     kalscope_fixed_real step; /* how far x goes in the next sample */
} kalscope_fixed;

$constants
/* Takes one sample, NAN where none came, and returns the filtered value. */
static inline kalscope_fixed_real kalscope_fixed_update(kalscope_fixed *filter, kalscope_fixed_real z)
{
@plain     if (z != z) return filter->x;
@plain     if (filter->x != filter->x) filter->x = z;
@plain     filter->x = filter->x + filter->k * (z - filter->x);
@momentum     const kalscope_fixed_real ahead = filter->x != filter->x ? z : filter->x + filter->step;
@momentum     const kalscope_fixed_real v = z != z ? 0 : z - ahead;
@momentum     filter->x = ahead + filter->k * v;
@momentum     filter->step = filter->e * filter->step + filter->l * v;
    return filter->x;
}

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
