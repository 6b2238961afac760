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

$types
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
