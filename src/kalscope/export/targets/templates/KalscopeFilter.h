$about
//
//   KalscopeFilter filter($first);
//   float filtered = filter.update(raw);      // NAN where a sample is missing
//
// The five lines of the scalar Kalman filter in float (32 bits), without heap, one object a channel.
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

struct KalscopeTuning {
  float q;             // process noise: variance added per sample, unit squared
  float r;             // measurement noise: variance, unit squared
  float p0;            // start variance; INFINITY: the first sample sets x = z and p = r
  float x0;            // start estimate; NAN: the first sample
  float gate;          // a sample with v * v > gate * s is not used, $gate_limit in a row at most; 0: no gate
  float settled_gain;  // gain once the variance has settled, where float is too coarse to find it; 0: not needed
};

$tunings
class KalscopeFilter {
 public:
  explicit KalscopeFilter(const KalscopeTuning &values) : tuning(values) { restart(); }

  // Starts again from p0 and x0.
  void restart() {
    x = tuning.x0;
    p = tuning.p0;
    k = 0.0f;
    rejected = 0;
  }

  // Takes one sample and returns the filtered value. NAN where none came: then the variance grows and x stays.
  float update(float z) {
    const float before = p;
    p = p + tuning.q;
    const float predicted = p;
    const float s = predicted + tuning.r;
    k = 0.0f;
    if (z != z) return x;
    if (isinf(predicted)) {  // nothing was known: believe the first sample
      k = 1.0f;
      p = tuning.r;
      x = z;
    } else if (x != x) {  // p0 is known, the first sample is the start
      k = s > 0.0f ? predicted / s : 0.0f;
      p = (1.0f - k) * predicted;
      x = z;
    } else if (s > 0.0f) {
      const float v = z - x;
      if (tuning.gate > 0.0f && v * v > tuning.gate * s && rejected < $gate_limit) {
        rejected++;
        return x;
      }
      k = predicted / s;
      p = (1.0f - k) * predicted;
      if (tuning.settled_gain > 0.0f && p == before) k = tuning.settled_gain;
      x = x + k * v;
    } else {
      return x;  // the estimate and the sample both claim to be exact: keep the estimate
    }
    rejected = 0;
    return x;
  }

  KalscopeTuning tuning;  // q, r and gate may be changed at any time, p0 and x0 act at the next restart()
  float x;                // filtered value; NAN before the first sample
  float p;                // its variance
  float k;                // gain of the last sample, 0 to 1

 private:
  uint8_t rejected;  // by the gate, in a row
};

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
