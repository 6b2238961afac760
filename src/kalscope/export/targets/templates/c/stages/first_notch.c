=== tuning
    kalscope_real notch_gain;   /* notch before the filter: what is passed at once, or 0: none; */
    kalscope_real notch_turn;   /* its frequency, */
    kalscope_real notch_decay;  /* and how fast it forgets */
=== state
    kalscope_real notch_level;  /* the first sample of the notch; NAN: none has come */
    kalscope_real notch_sums[2]; /* what the notch remembers of the samples before */
=== start
    filter->notch_level = NAN;
    filter->notch_sums[0] = filter->notch_sums[1] = 0;
=== before
    if (filter->tuning.notch_gain > 0 && isfinite(z)) z = kalscope_notch(filter, z);
=== update

/* Takes one frequency out: a second-order section of what is above the first sample. */
static kalscope_real kalscope_notch(kalscope_filter *filter, kalscope_real z)
{
    const kalscope_tuning *tuning = &filter->tuning;
    kalscope_real above, passed, gained;
    if (isnan(filter->notch_level)) filter->notch_level = z;
    above = z - filter->notch_level;
    gained = tuning->notch_gain * above;
    passed = gained + filter->notch_sums[0];
    filter->notch_sums[0] = tuning->notch_turn * (above - passed) + filter->notch_sums[1];
    filter->notch_sums[1] = gained - tuning->notch_decay * passed;
    return filter->notch_level + passed;
}
