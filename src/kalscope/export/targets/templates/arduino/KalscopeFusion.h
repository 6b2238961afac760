$about
//
//   KalscopeFusion fusion($first);
//   const float readings[] = {$words};
//   float fused = fusion.update(readings);  // a sensor that has no reading now: NAN
//   fused = fusion.update(readings, 0b$all_bits);  // or clear its bit; the lowest is that of the first sensor
//
// The Kalman filter of several sensors in float (32 bits), without heap.
// Written for C++11: Arduino, PlatformIO, ESP-IDF. Do not compile it with -ffast-math: NAN would be lost.

#ifndef KALSCOPE_FUSION_H
#define KALSCOPE_FUSION_H

#include <math.h>
#include <stdint.h>

// A processor that fuses x + k * v into one rounding gives other last bits than Kalscope shows.
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__AVR__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

typedef float kalscope_fusion_real;
enum { KALSCOPE_SENSORS = $count };
enum { MOST_REJECTED = $gate_limit };  // in a row; the next reading is taken, so that a gate cannot lock out

$types
typedef kalscope_fusion_tuning KalscopeFusionTuning;

$tunings
$functions
class KalscopeFusion : public kalscope_fusion {
 public:
  explicit KalscopeFusion(const KalscopeFusionTuning &values) { kalscope_fusion_start(this, &values); }

  // Starts again.
  void restart() { kalscope_fusion_start(this, &tuning); }

  // Takes a row, one reading a sensor, and returns the fused value. A reading is left out where it is NAN or where its
  // bit of `valid` is 0.
  float update(const float readings[], uint8_t valid = 255) { return kalscope_fusion_update(this, readings, valid); }
};

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
