$about

/*
 *   kalscope_filter filter;
 *   kalscope_start(&filter, &kalscope_tuning_$first);
 *   filtered = kalscope_update(&filter, raw);      NAN where a sample is missing
 *
 * C99, in double; with -DKALSCOPE_FLOAT in float (32 bits), for every file that includes this one. No heap.
 * The results are those of Kalscope to the last bit where a processor rounds each operation once (SSE, ARM, AVR;
 * not the x87 of old PCs). The .c file keeps GCC and Clang from fusing x + k * v; elsewhere use -ffp-contract=off.
 * Never compile it with -ffast-math: NAN would be lost.
 */
#ifndef KALSCOPE_FILTER_C_H
#define KALSCOPE_FILTER_C_H

#ifdef KALSCOPE_FLOAT
typedef float kalscope_real;
#else
typedef double kalscope_real;
#endif

#ifdef __cplusplus
extern "C" {
#endif

$types
$declarations

/* Starts, or starts again, with these values. */
void kalscope_start(kalscope_filter *filter, const kalscope_tuning *tuning);

/* Takes one sample, NAN where none came, and returns the filtered value. */
kalscope_real kalscope_update(kalscope_filter *filter, kalscope_real z);

#ifdef __cplusplus
}
#endif

#endif
