$about
//
//   KalscopeFilter filter($first);
//   float filtered = filter.update(raw);      // NAN where a sample is missing
//
// Filters in float (32 bits), without heap, one object a channel. Your code is the same for every filter.
// Written for C++11: Arduino, PlatformIO, ESP-IDF. Do not compile it with -ffast-math: NAN would be lost.

#ifndef KALSCOPE_FILTER_H
#define KALSCOPE_FILTER_H

#include <math.h>
#include <stdint.h>

// A processor that fuses x + k * v into one rounding gives other last bits than Kalscope shows.
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__AVR__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

typedef float kalscope_real;
@kalman enum { MOST_REJECTED = $gate_limit };  // in a row; the next sample is taken, so that a gate cannot lock out

$types
typedef kalscope_tuning KalscopeTuning;

$tunings
$functions
class KalscopeFilter : public kalscope_filter {
 public:
  explicit KalscopeFilter(const KalscopeTuning &values) { kalscope_start(this, &values); }

  // Starts again.
  void restart() { kalscope_start(this, &tuning); }

${set_momentum}  // Takes one sample and returns the filtered value, x. NAN where none came: then it is held, or predicted.
  float update(float z) { return kalscope_update(this, z); }
};

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
