=== tuning
    int median;                 /* samples whose median goes into the filter; 1: each sample itself */
=== state
    kalscope_real first_recent[$first_window], first_ordered[$first_window]; /* samples of the median: by time, by size */
    int first_place;        /* the oldest of them; -1: none has come */
=== start
    filter->first_place = -1;
=== before
    if (filter->tuning.median > 1 && isfinite(z)) {
        z = kalscope_middle(z, filter->first_place < 0, filter->tuning.median, filter->first_recent,
                            filter->first_ordered, &filter->first_place);
    }
