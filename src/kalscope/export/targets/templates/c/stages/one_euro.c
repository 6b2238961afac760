=== tuning
    kalscope_real slowest;      /* one-euro filter: 2 pi times its cut-off at speed 0, cycles a sample, */
    kalscope_real growth;       /* times the growth of that with the speed, */
    kalscope_real of_speed;     /* and times the cut-off of the speed */
=== state
    kalscope_real rest;     /* what rounding left out of the last sum, so that no small step is lost */
    kalscope_real speed;    /* unit per sample */
    kalscope_real elapsed;  /* samples since the last one that was not missing */
=== start
    filter->rest = 0;
    filter->speed = filter->elapsed = 0;
=== update

/* One-euro filter: exponential smoothing whose cut-off grows with the speed. */
static kalscope_real kalscope_one_euro(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    const kalscope_real most = (kalscope_real)1e30; /* beyond it the sample itself */
    const kalscope_real before = filter->x, elapsed = filter->elapsed + 1;
    filter->elapsed = elapsed;
    if (!isfinite(z)) return before;
    filter->elapsed = 0;
    if (isnan(before)) {
        filter->x = z;
    } else {
        const kalscope_real apart = (z - before) - filter->rest;
        const kalscope_real share = tuning->of_speed / (1 + tuning->of_speed * elapsed);
        const kalscope_real speed = filter->speed + share * (apart - elapsed * filter->speed);
        kalscope_real turn = (tuning->slowest + tuning->growth * (speed < 0 ? -speed : speed)) * elapsed;
        kalscope_real step;
        if (!(turn < most)) turn = most;
        step = filter->rest + turn / (1 + turn) * apart;
        filter->speed = speed;
        filter->x = before + step;
        filter->rest = step - (filter->x - before);
    }
    return filter->x;
}
