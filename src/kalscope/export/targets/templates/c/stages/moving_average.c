=== tuning
    int window;                 /* samples of the moving average or the median */
=== state
    kalscope_real recent[$window]; /* the last samples */
    int place;              /* the oldest of them */
    int count;              /* how many have arrived, up to the window */
    kalscope_real level, total; /* a level, and the sum of the window around it */
    kalscope_real next_level, next_total; /* the same of this pass through the window */
=== start
    filter->place = 0;
    filter->count = 0;
    filter->level = filter->total = filter->next_level = filter->next_total = 0;
=== update

/* Moving average. Once per pass through the window its sum is replaced by a new one: no rounding error lasts longer. */
static kalscope_real kalscope_moving_average(kalscope_filter *filter, kalscope_real z)
{
    if (!isfinite(z)) return filter->x;
    if (filter->place == 0) {
        filter->next_level = z;
        filter->next_total = 0;
    }
    if (filter->count < filter->tuning.window) {
        if (isnan(filter->x)) filter->level = z;
        filter->count++;
        filter->total = filter->total + (z - filter->level);
    } else {
        filter->total = filter->total + (z - filter->recent[filter->place]);
    }
    filter->next_total = filter->next_total + (z - filter->next_level);
    filter->recent[filter->place] = z;
    filter->place++;
    if (filter->place == filter->tuning.window) {
        filter->place = 0;
        filter->level = filter->next_level;
        filter->total = filter->next_total;
    }
    filter->x = filter->level + filter->total / (kalscope_real)filter->count;
    return filter->x;
}
