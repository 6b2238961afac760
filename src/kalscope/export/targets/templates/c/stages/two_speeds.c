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
    const kalscope_real y = u < 1 ? u : u * (kalscope_real)0.125;
    const kalscope_real even = 1 + y * y * (kalscope_real)0.1;
    const kalscope_real odd = y * ((kalscope_real)0.5 + y * y * (kalscope_real)$odd);
    kalscope_real power;
    if (!(u < $never)) return 0;
    power = (even - odd) / (even + odd);
    if (u < 1) return power;
    power = power * power;
    power = power * power;
    return power * power;
}

static kalscope_real kalscope_root(kalscope_real x)
{
    return sizeof x == sizeof(float) ? (kalscope_real)sqrtf((float)x) : (kalscope_real)sqrt((double)x);
}

/* Two speeds: at rest or moving, each with a good sample or a spike; x and p are the mean of the four. */
static kalscope_real kalscope_two_speeds(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    const kalscope_real share = (kalscope_real)$share, lasting = (kalscope_real)$lasting;
    const kalscope_real q = tuning->q, r = tuning->r, spikes = tuning->spikes, before = filter->p;
    const kalscope_real grown = tuning->fast * q;
    const kalscope_real moving = share + lasting * (filter->moving - share);
    const int first = spikes > 0 ? 0 : 2;
    kalscope_real v, half, k, whole, spread, least = 0, total = 0, mean = 0, squares = 0, left = 0, faster = 0;
    int i;

    filter->moving = moving;
    filter->k = 0;
    if (!isfinite(z) || isinf(before) || isnan(filter->x)) {
        const kalscope_real ahead = before + q + moving * (grown - q);
        filter->p = ahead;
        if (!isfinite(z)) return filter->x;
        /* The first sample: p continues from p0, or is r where nothing was known. */
        filter->k = isinf(before) ? 1 : ahead / (ahead + r * (1 + spikes * ($spike - 1)));
        filter->p = filter->k * r;
        filter->x = z;
        return z;
    }
    v = z - filter->x;
    half = (kalscope_real)0.5 * v * v;
    for (i = first; i < 4; i++) { /* the widest first: its exponent is the smallest */
        const kalscope_real noise = i < 2 ? $spike * r : r;
        const kalscope_real predicted = before + (i & 1 ? q : grown);
        const kalscope_real certain = 1 / (predicted + noise);
        const kalscope_real exponent = half * certain;
        const kalscope_real gain = predicted * certain;
        kalscope_real weight = (i < 2 ? spikes : 1 - spikes) * (i & 1 ? 1 - moving : moving);
        kalscope_real part;
        if (i == first) least = exponent;
        weight = weight * kalscope_root(certain);
        weight = weight * kalscope_exp_minus(exponent - least);
        part = weight * gain;
        total = total + weight;
        mean = mean + part;
        squares = squares + part * gain;
        left = left + part * noise;
        if (!(i & 1)) faster = faster + weight;
    }
    whole = 1 / total;
    k = mean * whole;
    spread = squares * whole - k * k;
    if (!(spread > 0)) spread = 0;
    filter->k = k;
    filter->moving = faster * whole;
    filter->p = left * whole + spread * v * v;
    filter->x = filter->x + k * v;
    return filter->x;
}
