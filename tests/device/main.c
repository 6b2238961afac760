/* Filters samples.bin with every tuning into filtered.bin, and prints what each took in ticks of a 25 MHz timer.
   With FUSION it then fuses the samples with those that follow them, as if several sensors read them. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "kalscope_filter.h"
#ifdef FUSION
#include "kalscope_fusion.h"
#endif

enum { MAX_SAMPLES = 10000 };
static kalscope_real z[MAX_SAMPLES], x[MAX_SAMPLES];
static volatile uint32_t *const timer = (volatile uint32_t *)0x40000000u; /* control, value, reload */

int main(void)
{
    const kalscope_tuning *tunings[] = {TUNINGS};
    FILE *samples = fopen("samples.bin", "rb"), *filtered = fopen("filtered.bin", "wb");
    if (!samples || !filtered) return EXIT_FAILURE;
    const size_t n = fread(z, sizeof z[0], MAX_SAMPLES, samples);
    timer[1] = timer[2] = UINT32_MAX; /* it counts down */
    timer[0] = 1;
    for (size_t i = 0; i < sizeof tunings / sizeof tunings[0]; i++) {
        kalscope_filter filter;
        kalscope_start(&filter, tunings[i]);
        const uint32_t before = timer[1];
        for (size_t j = 0; j < n; j++) x[j] = kalscope_update(&filter, z[j]);
        printf("%lu\n", (unsigned long)(before - timer[1]));
        if (fwrite(x, sizeof x[0], n, filtered) != n) return EXIT_FAILURE;
    }
#ifdef FUSION
    kalscope_fusion fusion;
    kalscope_fusion_start(&fusion, &FUSION);
    for (size_t i = 0; i < n; i++) {
        kalscope_fusion_real readings[KALSCOPE_SENSORS];
        for (size_t j = 0; j < KALSCOPE_SENSORS; j++) readings[j] = z[(i + j) % n];
        x[i] = kalscope_fusion_update(&fusion, readings, KALSCOPE_ALL_VALID);
    }
    if (fwrite(x, sizeof x[0], n, filtered) != n) return EXIT_FAILURE;
#endif
    fclose(filtered);
    return EXIT_SUCCESS;
}
