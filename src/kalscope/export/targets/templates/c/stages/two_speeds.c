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
    const kalscope_real y = u / $never;
    const kalscope_real even = 1 + y * y * (kalscope_real)0.1;
    const kalscope_real odd = y * ((kalscope_real)0.5 + y * y * (kalscope_real)$odd);
    kalscope_real power = (even - odd) / (even + odd);
    int i;
    if (!(u < $never)) return 0;
    for (i = 0; i < 5; i++) power = power * power;
    return power;
}

/* Two speeds: at rest or moving, each with a good sample or a spike; x and p are the mean of the four. */
static kalscope_real kalscope_two_speeds(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    const kalscope_real share = (kalscope_real)$share, lasting = (kalscope_real)$lasting;
    const kalscope_real q = tuning->q, r = tuning->r, spikes = tuning->spikes, before = filter->p;
    const kalscope_real grown = tuning->fast * q;
    const kalscope_real moving = share + lasting * (filter->moving - share);
    const kalscope_real ahead = before + q + moving * (grown - q);
    const kalscope_real s = ahead + r * (1 + spikes * ($spike - 1));
    kalscope_real v, half, least, k, spread, total = 0, mean = 0, squares = 0, left = 0, faster = 0;
    int i;

    filter->moving = moving;
    filter->p = ahead;
    filter->k = 0;
    if (isnan(z)) return filter->x;
    if (isinf(before)) { /* nothing was known: accept the first sample */
        filter->k = 1;
        filter->p = r;
        filter->x = z;
        return z;
    }
    if (isnan(filter->x)) { /* p0 is known, the first sample is the start */
        filter->k = ahead / s;
        filter->p = ahead / s * r;
        filter->x = z;
        return z;
    }
    v = z - filter->x;
    half = (kalscope_real)0.5 * v * v;
    least = half / (before + grown + (spikes > 0 ? $spike * r : r));
    for (i = 0; i < (spikes > 0 ? 4 : 2); i++) {
        const int is_fast = i & 1, is_spike = i >> 1;
        const kalscope_real noise = is_spike ? $spike * r : r;
        const kalscope_real predicted = before + (is_fast ? grown : q);
        const kalscope_real certain = 1 / (predicted + noise);
        const kalscope_real gain = predicted * certain;
        kalscope_real weight = (is_spike ? spikes : 1 - spikes) * (is_fast ? moving : 1 - moving);
        weight = weight * (kalscope_real)sqrt(certain);
        weight = weight * kalscope_exp_minus(half * certain - least);
        total = total + weight;
        mean = mean + weight * gain;
        squares = squares + weight * gain * gain;
        left = left + weight * gain * noise;
        if (is_fast) faster = faster + weight;
    }
    k = mean / total;
    spread = squares / total - k * k;
    if (!(spread > 0)) spread = 0;
    filter->k = k;
    filter->moving = faster / total;
    filter->p = left / total + spread * v * v;
    filter->x = filter->x + k * v;
    return filter->x;
}
