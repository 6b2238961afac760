=== tuning
    kalscope_real q;            /* process noise: variance added per sample, unit squared */
    kalscope_real r;            /* measurement noise: variance, unit squared */
    kalscope_real p0;           /* start variance; INFINITY: the first sample sets x = z and p = r */
    kalscope_real x0;           /* start estimate; NAN: the first sample */
    kalscope_real fast;         /* two speeds: q is this many times larger while the signal moves */
    kalscope_real spikes;       /* probability that a sample is a spike, of $spike r */
=== state
    kalscope_real p;        /* its variance */
    kalscope_real k;        /* gain of the last sample, 0 to 1 */
    kalscope_real moving;   /* probability that the signal moves */
=== start
    filter->x = tuning->x0;
    filter->p = tuning->p0;
    filter->k = 0;
    filter->moving = (kalscope_real)$share;
=== update

/* e^-u by arithmetic alone: the same digits on every processor. */
static kalscope_real kalscope_exp_minus(kalscope_real u)
{
    const kalscope_real even = 1 + u * u * (kalscope_real)$even, odd = u * (kalscope_real)0.03125;
    kalscope_real power;
    if (u == 0) return 1; /* at least one of three: saves its division */
    if (u >= $never) return 0;
    power = (even - odd) / (even + odd);
    power = power * power;
    power = power * power;
    power = power * power;
    return power * power;
}

static kalscope_real kalscope_root(kalscope_real x)
{
    return sizeof x == sizeof(float) ? (kalscope_real)sqrtf((float)x) : (kalscope_real)sqrt((double)x);
}

/* Two speeds: a spike, moving or at rest; x and p are the mean of the three. */
static kalscope_real kalscope_two_speeds(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    const kalscope_real share = (kalscope_real)$share, lasting = (kalscope_real)$lasting, spike = $spike;
    const kalscope_real q = tuning->q, r = tuning->r, spikes = tuning->spikes, before = filter->p;
    const kalscope_real moving = share + lasting * (filter->moving - share);
    const kalscope_real grown = tuning->fast * q, ahead = before + q + moving * (grown - q);
    const kalscope_real slow = before + q, quick = before + grown, good = 1 - spikes;
    const kalscope_real wide = quick + r;
    kalscope_real c0 = 0, c1, c2, w0 = 0, w1, w2, k0, k1, k2, v, square, half, least, whole, spread;

    filter->moving = moving;
    filter->k = 0;
    if (!isfinite(z) || isinf(before) || isnan(filter->x)) {
        filter->p = ahead;
        if (!isfinite(z)) return filter->x;
        /* The first sample: p continues from p0, or is r where nothing was known. */
        filter->k = isinf(before) ? 1 : ahead / (ahead + r * (1 + spikes * (spike - 1)));
        filter->p = filter->k * r;
        filter->x = z;
        return z;
    }
    v = z - filter->x;
    square = v * v;
    half = (kalscope_real)0.5 * square;
    c1 = 1 / wide;
    c2 = 1 / (slow + r);
    least = half * c1; /* the smallest exponent: one weight always stays */
    if (spikes > 0) {
        c0 = 1 / (ahead + spike * r);
        if (half * c0 < least) least = half * c0;
        w0 = spikes * kalscope_root(c0 * wide) * kalscope_exp_minus(half * c0 - least);
    }
    w1 = good * moving * kalscope_exp_minus(half * c1 - least);
    w2 = good * (1 - moving) * kalscope_root(c2 * wide) * kalscope_exp_minus(half * c2 - least);
    whole = 1 / (w0 + w1 + w2);
    w0 = w0 * whole;
    w1 = w1 * whole;
    filter->moving = w1 + w0 * moving;
    k0 = ahead * c0;
    k1 = quick * c1;
    k2 = slow * c2;
    w0 = w0 * k0;
    w1 = w1 * k1;
    w2 = w2 * whole * k2;
    filter->k = w0 + w1 + w2;
    spread = w0 * k0 + w1 * k1 + w2 * k2 - filter->k * filter->k;
    if (!(spread > 0)) spread = 0;
    filter->p = (spike * w0 + w1 + w2) * r + spread * square;
    filter->x = filter->x + filter->k * v;
    return filter->x;
}
