=== types
typedef struct {
    kalscope_fusion_real q;        /* process noise: variance added per row of readings, unit squared */
    kalscope_fusion_real p0;       /* start variance; INFINITY: the first reading sets x and p */
    kalscope_fusion_real x0;       /* start estimate; NAN: the first reading */
    kalscope_fusion_real gate;     /* a reading with v * v > gate * s is not used; 0: no gate */
@momentum     kalscope_fusion_real momentum; /* tau, how long the signal keeps its direction, in samples; the others follow */
@momentum     kalscope_fusion_real e;        /* from q and tau: share of the velocity left after a sample, */
@momentum     kalscope_fusion_real f;        /* how far a velocity of 1 goes in a sample, */
@momentum     kalscope_fusion_real q11;      /* variance added per sample to x, */
@momentum     kalscope_fusion_real q12;      /* to the covariance of x and the velocity, */
@momentum     kalscope_fusion_real q22;      /* and to the velocity, */
@momentum     kalscope_fusion_real w0;       /* and its variance at the start */
    kalscope_fusion_real r[KALSCOPE_SENSORS];      /* noise of each sensor on the scale of x: variance / gain squared */
    kalscope_fusion_real offset[KALSCOPE_SENSORS]; /* what each sensor reads where x is 0 */
@gains     kalscope_fusion_real gain[KALSCOPE_SENSORS];   /* by how much its reading grows with x */
} kalscope_fusion_tuning;

typedef struct {
    kalscope_fusion_tuning tuning;
    kalscope_fusion_real x;        /* fused value; NAN before the first reading */
    kalscope_fusion_real p;        /* its variance */
    kalscope_fusion_real k[KALSCOPE_SENSORS]; /* gain of each reading of the last row, 0 to 1; 0 where it was left out */
@momentum     kalscope_fusion_real velocity; /* fused velocity, unit per sample */
@momentum     kalscope_fusion_real g;        /* covariance of x and the velocity */
@momentum     kalscope_fusion_real w;        /* variance of the velocity */
    int rejected[KALSCOPE_SENSORS]; /* readings that the gate rejected in a row */
} kalscope_fusion;
=== functions
${linkage}void kalscope_fusion_start(kalscope_fusion *fusion, const kalscope_fusion_tuning *tuning)
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

${linkage}kalscope_fusion_real kalscope_fusion_update(
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
    for (int i = 0; i < KALSCOPE_SENSORS; i++, valid >>= 1) {
        const kalscope_fusion_real z = $reading;
        fusion->k[i] = 0;
        if ((valid & 1) && isfinite(z)) take(fusion, i, z);
    }
    return fusion->x;
}
