=== tuning
    kalscope_real q;            /* process noise: variance added per sample, unit squared */
    kalscope_real r;            /* measurement noise: variance, unit squared */
    kalscope_real p0;           /* start variance; INFINITY: the first sample sets x = z and p = r */
    kalscope_real x0;           /* start estimate; NAN: the first sample */
    kalscope_real gate;         /* a sample with v * v > gate * s is not used; 0: no gate */
@momentum     kalscope_real momentum;     /* tau, how long the signal keeps its direction, in samples; 0: the five lines */
@momentum     kalscope_real e;            /* the others follow from q and tau: share of the velocity left after a sample, */
@momentum     kalscope_real f;            /* how far a velocity of 1 goes in a sample, */
@momentum     kalscope_real q11;          /* variance added per sample to x, */
@momentum     kalscope_real q12;          /* to the covariance of x and the velocity, */
@momentum     kalscope_real q22;          /* and to the velocity, */
@momentum     kalscope_real w0;           /* and its variance at the start */
=== state
    kalscope_real p;        /* its variance */
    kalscope_real k;        /* gain of the last sample, 0 to 1 */
@momentum     kalscope_real velocity; /* filtered velocity, unit per sample */
@momentum     kalscope_real g;        /* covariance of x and the velocity */
@momentum     kalscope_real w;        /* variance of the velocity */
    int rejected;           /* samples that the gate rejected in a row */
=== start
    filter->x = tuning->x0;
    filter->p = tuning->p0;
    filter->k = 0;
@momentum     filter->velocity = 0;
@momentum     filter->g = 0;
@momentum     filter->w = tuning->w0;
    filter->rejected = 0;
=== update
@momentum 
@momentum /* The velocity gain of a sample; the variance w and the covariance g shrink by it. */
@momentum static kalscope_real ${prefix}velocity_gain(kalscope_filter *filter, kalscope_real s)
@momentum {
@momentum     const kalscope_real gain = filter->g / s;
@momentum     filter->w = filter->w - gain * filter->g;
@momentum     filter->g = gain * filter->tuning.r;
@momentum     return gain;
@momentum }

$update(kalscope_filter *filter, kalscope_real z)
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
    if (!isfinite(z)) return filter->x;
    if (isinf(predicted)) { /* nothing was known: accept the first sample */
        filter->k = 1;
        filter->p = tuning->r;
@momentum         filter->g = 0;
        filter->x = z;
    } else if (isnan(filter->x)) { /* p0 is known, the first sample is the start */
        filter->k = s > 0 ? predicted / s : 0;
        filter->p = filter->k * tuning->r;
@momentum         if (s > 0) ${prefix}velocity_gain(filter, s);
        filter->x = z;
    } else if (s > 0) {
        const kalscope_real v = z - filter->x;
        if (tuning->gate > 0 && v * v > tuning->gate * s && filter->rejected < MOST_REJECTED) {
            filter->rejected++;
            return filter->x;
        }
        filter->k = predicted / s;
        filter->p = filter->k * tuning->r;
@momentum         filter->velocity = filter->velocity + ${prefix}velocity_gain(filter, s) * v;
        filter->x = filter->x + filter->k * v;
    } else {
        return filter->x; /* the estimate and the sample both claim to be exact: keep the estimate */
    }
    filter->rejected = 0;
    return filter->x;
}
