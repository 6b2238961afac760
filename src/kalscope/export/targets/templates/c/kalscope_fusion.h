$about

/*
 *   kalscope_fusion fusion;
 *   kalscope_fusion_real readings[KALSCOPE_SENSORS] = {$words};
 *   kalscope_fusion_start(&fusion, &kalscope_fusion_tuning_$name);
 *   fused = kalscope_fusion_update(&fusion, readings, KALSCOPE_ALL_VALID);    NAN where a sensor has no reading
 *
 * C99, in double; with -DKALSCOPE_FLOAT in float (32 bits), for every file that includes this one. No heap.
 * The results are those of Kalscope to the last bit where a processor rounds each operation once (SSE, ARM, AVR;
 * not the x87 of old PCs). The .c file keeps GCC and Clang from fusing x + k * v; elsewhere use -ffp-contract=off.
 * Never compile it with -ffast-math: NAN would be lost.
 */
#ifndef KALSCOPE_FUSION_C_H
#define KALSCOPE_FUSION_C_H

#include <stdint.h>

#ifdef KALSCOPE_FLOAT
typedef float kalscope_fusion_real;
#else
typedef double kalscope_fusion_real;
#endif

#ifdef __cplusplus
extern "C" {
#endif

enum { KALSCOPE_SENSORS = $count };
#define KALSCOPE_ALL_VALID UINT32_MAX

typedef struct {
    kalscope_fusion_real q;        /* process noise: variance added per row of readings, unit squared */
    kalscope_fusion_real p0;       /* start variance; INFINITY: the first reading sets x and p */
    kalscope_fusion_real x0;       /* start estimate; NAN: the first reading */
    kalscope_fusion_real gate;     /* a reading with v * v > gate * s is not used; 0: no gate */
@momentum     kalscope_fusion_real momentum; /* tau, how long the signal keeps its direction, in samples; the others follow */
@momentum     kalscope_fusion_real e;        /* from q and tau: share of the velocity left after a sample, */
@momentum     kalscope_fusion_real f;        /* how far a velocity of 1 goes in a sample, */
@momentum     kalscope_fusion_real q11;      /* variance added per sample to x, */
@momentum     kalscope_fusion_real q12;      /* to the covariance of x and the velocity, */
@momentum     kalscope_fusion_real q22;      /* and to the velocity, */
@momentum     kalscope_fusion_real w0;       /* and its variance at the start */
    kalscope_fusion_real r[KALSCOPE_SENSORS];      /* noise of each sensor on the scale of x: variance / gain squared */
    kalscope_fusion_real offset[KALSCOPE_SENSORS]; /* what each sensor reads where x is 0 */
@gains     kalscope_fusion_real gain[KALSCOPE_SENSORS];   /* by how much its reading grows with x */
} kalscope_fusion_tuning;

typedef struct {
    kalscope_fusion_tuning tuning;
    kalscope_fusion_real x;        /* fused value; NAN before the first reading */
    kalscope_fusion_real p;        /* its variance */
    kalscope_fusion_real k[KALSCOPE_SENSORS]; /* gain of each reading of the last row, 0 to 1; 0 where it was left out */
@momentum     kalscope_fusion_real velocity; /* fused velocity, unit per sample */
@momentum     kalscope_fusion_real g;        /* covariance of x and the velocity */
@momentum     kalscope_fusion_real w;        /* variance of the velocity */
    int rejected[KALSCOPE_SENSORS]; /* readings that the gate rejected in a row */
} kalscope_fusion;

extern const kalscope_fusion_tuning kalscope_fusion_tuning_$name;

/* Starts, or starts again, with these values. */
void kalscope_fusion_start(kalscope_fusion *fusion, const kalscope_fusion_tuning *tuning);

/* Takes a row, one reading a sensor, and returns the fused value. A reading is left out where it is NAN, or where its
   bit of `valid` is 0; the lowest bit is that of the first sensor. */
kalscope_fusion_real kalscope_fusion_update(
    kalscope_fusion *fusion, const kalscope_fusion_real *readings, uint32_t valid);

#ifdef __cplusplus
}
#endif

#endif
