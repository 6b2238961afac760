=== tuning
    kalscope_real to_slope;     /* second-order low-pass: shares per sample, of the slope in the level, */
    kalscope_real decay;        /* of the slope that is lost, */
    kalscope_real to_level;     /* and of the distance in the level */
=== state
    kalscope_real rest;     /* what rounding left out of the last sum, so that no small step is lost */
    kalscope_real base, slope; /* the two integrators of the low-pass */
=== start
    filter->rest = 0;
    filter->base = filter->slope = 0;
=== update

/* Second-order low-pass (Butterworth) of two integrators, which stays exact where the cut-off is low. */
static kalscope_real kalscope_butterworth(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    kalscope_real before, slope, apart, step;
    if (!isfinite(z)) return filter->x;
    if (isnan(filter->x)) filter->base = z;
    before = filter->base;
    slope = filter->slope;
    apart = (z - before) - filter->rest;
    step = tuning->to_slope * slope + tuning->to_level * apart;
    filter->x = before + (filter->rest + (kalscope_real)0.5 * step);
    filter->slope = slope + (tuning->to_slope * apart - tuning->decay * slope);
    step = filter->rest + step;
    filter->base = before + step;
    filter->rest = step - (filter->base - before);
    return filter->x;
}
