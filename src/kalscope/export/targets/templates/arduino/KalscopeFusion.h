$about
//
//   KalscopeFusion fusion($first);
//   const float readings[] = {$words};
//   float fused = fusion.update(readings);  // a sensor that has no reading now: NAN
//   fused = fusion.update(readings, 0b$all_bits);  // or clear its bit; the lowest is that of the first sensor
//
@plain // The scalar Kalman filter of several sensors in float (32 bits), without heap: the five lines, an update a sensor.
@momentum // The Kalman filter with momentum of several sensors in float (32 bits), without heap: its second state is the
@momentum // velocity, and each sensor is an update.
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

const uint8_t KALSCOPE_SENSORS = $count;

struct KalscopeFusionTuning {
  float q;     // process noise: variance added per row of readings, unit squared
  float p0;    // start variance; INFINITY: the first reading sets x and p
  float x0;    // start estimate; NAN: the first reading
  float gate;  // a reading with v * v > gate * s is not used, $gate_limit in a row of a sensor at most; 0: no gate
@momentum   float momentum;  // tau, how long the signal keeps its direction, in samples. The others follow from q and tau:
@momentum   float e;         // the share of the velocity that is left after a sample,
@momentum   float f;         // how far a velocity of 1 goes in a sample,
@momentum   float q11;       // variance added per sample to x,
@momentum   float q12;       // to the covariance of x and the velocity,
@momentum   float q22;       // and to the velocity,
@momentum   float w0;        // and its variance at the start
@plain   float r[KALSCOPE_SENSORS];       // measurement noise of each sensor on the scale of x: its variance / gain squared
@momentum   float r[KALSCOPE_SENSORS];  // measurement noise of each sensor on the scale of x: its variance / gain squared
  float offset[KALSCOPE_SENSORS];  // what each sensor reads where x is 0
@gains   float gain[KALSCOPE_SENSORS];    // by how much its reading grows with x
};

$tunings
class KalscopeFusion {
 public:
  explicit KalscopeFusion(const KalscopeFusionTuning &values) : tuning(values) { restart(); }

  // Starts again from p0 and x0.
  void restart() {
    x = tuning.x0;
    p = tuning.p0;
@momentum     velocity = 0.0f;
@momentum     g = 0.0f;
@momentum     w = tuning.w0;
    for (uint8_t i = 0; i < KALSCOPE_SENSORS; i++) {
      k[i] = 0.0f;
      rejected[i] = 0;
    }
  }

  // Takes a row, one reading a sensor, and returns the fused value. A reading is left out where it is NAN or where its
@plain   // bit of `valid` is 0; where all are, the variance grows and x stays.
@momentum   // bit of `valid` is 0; where all are, x continues at its velocity.
  float update(const float readings[], uint8_t valid = 255) {
@plain     p = p + tuning.q;
@momentum     const float carried = tuning.f * w;
@momentum     p = p + tuning.f * (2.0f * g + carried) + tuning.q11;
@momentum     g = tuning.e * (g + carried) + tuning.q12;
@momentum     w = tuning.e * tuning.e * w + tuning.q22;
@momentum     x = x + tuning.f * velocity;
@momentum     velocity = tuning.e * velocity;
    for (uint8_t i = 0; i < KALSCOPE_SENSORS; i++) {
      const float z = $reading;
      k[i] = 0.0f;
      if ((valid >> i & 1) && z == z) take(i, z);
    }
    return x;
  }

  KalscopeFusionTuning tuning;
  float x;                    // fused value; NAN before the first reading
  float p;                    // its variance
  float k[KALSCOPE_SENSORS];  // gain of each sensor's reading in the last row, 0 to 1; 0 where it was left out
@momentum   float velocity;             // fused velocity, unit per sample

 private:
  // The update with one reading, on the scale of x.
  void take(uint8_t i, float z) {
    const float s = p + tuning.r[i];
    if (isinf(p)) {  // nothing was known: accept the first reading
      k[i] = 1.0f;
      p = tuning.r[i];
@momentum       g = 0.0f;
      x = z;
    } else if (x != x) {  // p0 is known, the first reading is the start
      k[i] = s > 0.0f ? p / s : 0.0f;
@momentum       if (s > 0.0f) velocityGain(i, s);
      p = k[i] * tuning.r[i];
      x = z;
    } else if (s > 0.0f) {
      const float v = z - x;
      if (tuning.gate > 0.0f && v * v > tuning.gate * s && rejected[i] < $gate_limit) {
        rejected[i]++;
        return;
      }
      k[i] = p / s;
@momentum       velocity = velocity + velocityGain(i, s) * v;
      p = k[i] * tuning.r[i];
      x = x + k[i] * v;
    } else {
      return;  // the estimate and the reading both claim to be exact: keep the estimate
    }
    rejected[i] = 0;
  }

@momentum   // The velocity gain of a reading; the variance w and the covariance g shrink by it.
@momentum   float velocityGain(uint8_t i, float s) {
@momentum     const float gain = g / s;
@momentum     w = w - gain * g;
@momentum     g = gain * tuning.r[i];
@momentum     return gain;
@momentum   }
@momentum 
@momentum   float g;                             // covariance of x and the velocity
@momentum   float w;                             // variance of the velocity
  uint8_t rejected[KALSCOPE_SENSORS];  // by the gate, in a row
};

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
