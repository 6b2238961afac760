$about

#include "kalscope_fusion.h"

#include <math.h>

/* A fused x + k * v is rounded once instead of twice: other last bits than Kalscope shows. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

enum { MOST_REJECTED = $gate_limit }; /* in a row; the next reading is taken, so that a gate cannot lock out */

$tunings
void kalscope_fusion_start(kalscope_fusion *fusion, const kalscope_fusion_tuning *tuning)
{
    fusion->tuning = *tuning;
    fusion->x = tuning->x0;
    fusion->p = tuning->p0;
@momentum     fusion->velocity = 0;
@momentum     fusion->g = 0;
@momentum     fusion->w = tuning->w0;
    for (int i = 0; i < KALSCOPE_SENSORS; i++) {
        fusion->k[i] = 0;
        fusion->rejected[i] = 0;
    }
}

@momentum /* The velocity gain of a reading; the variance w and the covariance g shrink by it. */
@momentum static kalscope_fusion_real velocity_gain(kalscope_fusion *fusion, int i, kalscope_fusion_real s)
@momentum {
@momentum     const kalscope_fusion_real gain = fusion->g / s;
@momentum     fusion->w = fusion->w - gain * fusion->g;
@momentum     fusion->g = gain * fusion->tuning.r[i];
@momentum     return gain;
@momentum }
@momentum 
/* The update with one reading, on the scale of x. */
static void take(kalscope_fusion *fusion, int i, kalscope_fusion_real z)
{
    const kalscope_fusion_tuning *tuning = &fusion->tuning;
    const kalscope_fusion_real p = fusion->p, s = p + tuning->r[i];

    if (isinf(p)) { /* nothing was known: accept the first reading */
        fusion->k[i] = 1;
        fusion->p = tuning->r[i];
@momentum         fusion->g = 0;
        fusion->x = z;
    } else if (isnan(fusion->x)) { /* p0 is known, the first reading is the start */
        fusion->k[i] = s > 0 ? p / s : 0;
        fusion->p = fusion->k[i] * tuning->r[i];
@momentum         if (s > 0) velocity_gain(fusion, i, s);
        fusion->x = z;
    } else if (s > 0) {
        const kalscope_fusion_real v = z - fusion->x;
        if (tuning->gate > 0 && v * v > tuning->gate * s && fusion->rejected[i] < MOST_REJECTED) {
            fusion->rejected[i]++;
            return;
        }
        fusion->k[i] = p / s;
        fusion->p = fusion->k[i] * tuning->r[i];
@momentum         fusion->velocity = fusion->velocity + velocity_gain(fusion, i, s) * v;
        fusion->x = fusion->x + fusion->k[i] * v;
    } else {
        return; /* the estimate and the reading both claim to be exact: keep the estimate */
    }
    fusion->rejected[i] = 0;
}

kalscope_fusion_real kalscope_fusion_update(
    kalscope_fusion *fusion, const kalscope_fusion_real *readings, uint32_t valid)
{
    const kalscope_fusion_tuning *tuning = &fusion->tuning;

@plain     fusion->p = fusion->p + tuning->q;
@momentum     const kalscope_fusion_real carried = tuning->f * fusion->w;
@momentum     fusion->p = fusion->p + tuning->f * (2 * fusion->g + carried) + tuning->q11;
@momentum     fusion->g = tuning->e * (fusion->g + carried) + tuning->q12;
@momentum     fusion->w = tuning->e * tuning->e * fusion->w + tuning->q22;
@momentum     fusion->x = fusion->x + tuning->f * fusion->velocity;
@momentum     fusion->velocity = tuning->e * fusion->velocity;
    for (int i = 0; i < KALSCOPE_SENSORS; i++) {
        const kalscope_fusion_real z = $reading;
        fusion->k[i] = 0;
        if ((valid >> i & 1) && !isnan(z)) take(fusion, i, z);
    }
    return fusion->x;
}
