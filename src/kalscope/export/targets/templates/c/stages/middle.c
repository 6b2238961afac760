=== update

/* The median of the last n samples: `recent` in the order in which they came, `ordered` by size. Both begin filled
   with the first sample. */
static kalscope_real kalscope_middle(
    kalscope_real z, int first, int n, kalscope_real *recent, kalscope_real *ordered, int *place)
{
    int i = 0;
    if (first) {
        for (*place = 0; i < n; i++) recent[i] = ordered[i] = z;
        i = 0;
    }
    while (ordered[i] != recent[*place]) i++; /* the oldest leaves */
    for (; i + 1 < n && ordered[i + 1] < z; i++) ordered[i] = ordered[i + 1];
    for (; i > 0 && ordered[i - 1] > z; i--) ordered[i] = ordered[i - 1];
    ordered[i] = recent[*place] = z;
    *place = *place + 1 < n ? *place + 1 : 0;
    return ordered[n / 2];
}
