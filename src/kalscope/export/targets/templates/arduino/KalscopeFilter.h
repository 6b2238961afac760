$about
//
//   KalscopeFilter filter($first);
//   float filtered = filter.update(raw);      // NAN where a sample is missing
//
@plain // The five lines of the scalar Kalman filter in float (32 bits), without heap, one object a channel.
@momentum // The scalar Kalman filter with momentum in float (32 bits), without heap, one object a channel: its second
@momentum // state is the velocity.
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
@momentum   float momentum;      // tau, how long the signal keeps its direction, in samples; 0: the five lines. The others
@momentum   float e;             // follow from q and tau: the share of the velocity that is left after a sample,
@momentum   float f;             // how far a velocity of 1 goes in a sample,
@momentum   float q11;           // variance added per sample to x,
@momentum   float q12;           // to the covariance of x and the velocity,
@momentum   float q22;           // and to the velocity,
@momentum   float w0;            // and its variance at the start
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
@momentum     velocity = 0.0f;
@momentum     g = 0.0f;
@momentum     w = tuning.w0;
    rejected = 0;
  }

@plain   // Takes one sample and returns the filtered value. NAN where none came: then the variance grows and x stays.
@momentum ${set_momentum}  // Takes one sample and returns the filtered value. NAN where none came: x continues at its velocity.
  float update(float z) {
    const float before = p;
@plain     p = p + tuning.q;
@momentum     const float carried = tuning.f * w;
@momentum     p = p + tuning.f * (2.0f * g + carried) + tuning.q11;
@momentum     g = tuning.e * (g + carried) + tuning.q12;
@momentum     w = tuning.e * tuning.e * w + tuning.q22;
@momentum     x = x + tuning.f * velocity;
@momentum     velocity = tuning.e * velocity;
    const float predicted = p;
    const float s = predicted + tuning.r;
    k = 0.0f;
    if (z != z) return x;
    if (isinf(predicted)) {  // nothing was known: accept the first sample
      k = 1.0f;
      p = tuning.r;
@momentum       g = 0.0f;
      x = z;
    } else if (x != x) {  // p0 is known, the first sample is the start
      k = s > 0.0f ? predicted / s : 0.0f;
      p = k * tuning.r;
@momentum       if (s > 0.0f) velocityGain(s);
      x = z;
    } else if (s > 0.0f) {
      const float v = z - x;
      if (tuning.gate > 0.0f && v * v > tuning.gate * s && rejected < $gate_limit) {
        rejected++;
        return x;
      }
      k = predicted / s;
      p = k * tuning.r;
@momentum       velocity = velocity + velocityGain(s) * v;
      if (tuning.settled_gain > 0.0f && p == before) k = tuning.settled_gain;
      x = x + k * v;
    } else {
      return x;  // the estimate and the sample both claim to be exact: keep the estimate
    }
    rejected = 0;
    return x;
  }

@plain   KalscopeTuning tuning;  // q, r and gate may be changed at any time, p0 and x0 act at the next restart()
@momentum   KalscopeTuning tuning;  // r and gate may be changed at any time, q and tau by setMomentum(); p0 and x0 act at the
@momentum                           // next restart()
  float x;                // filtered value; NAN before the first sample
  float p;                // its variance
  float k;                // gain of the last sample, 0 to 1
@momentum   float velocity;         // filtered velocity, unit per sample

 private:
@momentum   // The velocity gain of a sample; the variance w and the covariance g shrink by it.
@momentum   float velocityGain(float s) {
@momentum     const float gain = g / s;
@momentum     w = w - gain * g;
@momentum     g = gain * tuning.r;
@momentum     return gain;
@momentum   }
@momentum 
@momentum   float g;           // covariance of x and the velocity
@momentum   float w;           // variance of the velocity
  uint8_t rejected;  // by the gate, in a row
};

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
