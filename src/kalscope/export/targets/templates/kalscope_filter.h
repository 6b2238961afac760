$about

/*
 *   kalscope_filter filter;
 *   kalscope_start(&filter, &kalscope_tuning_$first);
 *   filtered = kalscope_update(&filter, raw);      NAN where a sample is missing
 *
 * C99, in double; with -DKALSCOPE_FLOAT in float (32 bits), for every file that includes this one. No heap.
 * The results are those of Kalscope to the last bit where a processor rounds each operation once (SSE, ARM, AVR;
 * not the x87 of old PCs). The .c file forbids GCC and Clang to fuse x + k * v; elsewhere use -ffp-contract=off.
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

typedef struct {
    kalscope_real q;            /* process noise: variance added per sample, unit squared */
    kalscope_real r;            /* measurement noise: variance, unit squared */
    kalscope_real p0;           /* start variance; INFINITY: the first sample sets x = z and p = r */
    kalscope_real x0;           /* start estimate; NAN: the first sample */
    kalscope_real gate;         /* a sample with v * v > gate * s is not used; 0: no gate */
    kalscope_real settled_gain; /* gain once the variance repeats itself, where float is too coarse; 0: not needed */
@momentum     kalscope_real momentum;     /* tau, how long the signal keeps its direction, in samples; 0: the five lines */
@momentum     kalscope_real e;            /* the others follow from q and tau: share of the velocity left after a sample, */
@momentum     kalscope_real f;            /* how far a velocity of 1 goes in a sample, */
@momentum     kalscope_real q11;          /* variance added per sample to x, */
@momentum     kalscope_real q12;          /* to the covariance of x and the velocity, */
@momentum     kalscope_real q22;          /* and to the velocity, */
@momentum     kalscope_real w0;           /* and its variance at the start */
} kalscope_tuning;

typedef struct {
@plain     kalscope_tuning tuning; /* q, r and gate may be changed at any time */
@momentum     kalscope_tuning tuning; /* r and gate may be changed at any time */
    kalscope_real x;        /* filtered value; NAN before the first sample */
    kalscope_real p;        /* its variance */
    kalscope_real k;        /* gain of the last sample, 0 to 1 */
@momentum     kalscope_real velocity; /* filtered velocity, unit per sample */
@momentum     kalscope_real g;        /* covariance of x and the velocity */
@momentum     kalscope_real w;        /* variance of the velocity */
    int rejected;           /* samples that the gate refused in a row */
} kalscope_filter;

$declarations

/* Starts, or starts again, with these values. */
void kalscope_start(kalscope_filter *filter, const kalscope_tuning *tuning);

/* Takes one sample, NAN where none came, and returns the filtered value. */
kalscope_real kalscope_update(kalscope_filter *filter, kalscope_real z);

#ifdef __cplusplus
}
#endif

#endif
