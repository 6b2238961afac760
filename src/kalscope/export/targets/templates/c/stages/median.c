=== tuning
    int window;                 /* samples of the moving average or the median */
=== state
    kalscope_real recent[$window]; /* the last samples */
    int place;              /* the oldest of them */
    kalscope_real ordered[$ordered]; /* the last samples by size */
=== start
    filter->place = 0;
=== update

/* Median. */
static kalscope_real kalscope_median(kalscope_filter *filter, kalscope_real z)
{
    if (!isfinite(z)) return filter->x;
    filter->x = kalscope_middle(z, isnan(filter->x), filter->tuning.window, filter->recent, filter->ordered,
                                &filter->place);
    return filter->x;
}
