=== tuning
    kalscope_real alpha;        /* share of each step that is taken */
=== state
    kalscope_real rest;     /* what rounding left out of the last sum, so that no small step is lost */
=== start
    filter->rest = 0;
=== update

/* Exponential smoothing. */
static kalscope_real kalscope_exponential(kalscope_filter *filter, kalscope_real z)
{
    kalscope_real before, step;
    if (!isfinite(z)) return filter->x;
    if (isnan(filter->x)) filter->x = z;
    before = filter->x;
    step = filter->rest + filter->tuning.alpha * ((z - before) - filter->rest);
    filter->x = before + step;
    filter->rest = step - (filter->x - before);
    return filter->x;
}
