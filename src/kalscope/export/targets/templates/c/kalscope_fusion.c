$about

#include "kalscope_fusion.h"

#include <math.h>

/* A fused x + k * v is rounded once instead of twice: other last bits than Kalscope shows. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

enum { MOST_REJECTED = $gate_limit }; /* in a row; the next reading is taken, so that a gate cannot lock out */

$tunings
$functions