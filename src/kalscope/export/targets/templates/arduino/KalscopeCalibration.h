// How noisy a sensor is while its input does not change: the variance r of its readings about a straight line, found
// sample by sample in float (32 bits), without heap and without keeping them; spikes are left out, a moving input is
// refused. Exported by Kalscope beside KalscopeFilter.h.
//
//   KalscopeCalibration calibration;
//   calibration.start(samples, KALSCOPE_READINGS);     // false: too few or too many
//   calibration.take(raw);                             // each sample; NAN where one is missing
//   if (calibration.state == KalscopeCalibration::FOUND) use(calibration.r);

#ifndef KALSCOPE_CALIBRATION_H
#define KALSCOPE_CALIBRATION_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__) && !defined(__AVR__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

// Identifies this export: values of another one in the EEPROM are not used.
const uint32_t KALSCOPE_STAMP = $stamp;

// q over r: the lag that was chosen stays when r is measured.
$ratios
// What is known about the readings beforehand, in their unit.
struct KalscopeReadings {
  float step;     // distance of two neighbouring values; 0: not known
  float lowest;   // readings from here down are cut off; -INFINITY: not known
  float highest;  // and from here up; INFINITY: not known
};

class KalscopeCalibration {
 public:
  enum State { IDLE, MEASURING, FOUND, MISSING, SPIKES, TOO_FEW, CUT_OFF, EQUAL, MOVING, UNEVEN, DEPENDENT, TOO_LARGE };

  static const uint8_t LEARNING = 16, GROUPS = $groups;
  static const uint16_t MIN_EACH = 8, MAX_EACH = 8000;
  static const uint32_t MIN_ROWS = LEARNING + (GROUPS + 1UL) * MIN_EACH;
  static const uint32_t MAX_ROWS = LEARNING + (GROUPS + 1UL) * MAX_EACH;

  // Begins: the first LEARNING readings and one group show where the readings lie, GROUPS groups are measured.
  bool start(uint32_t samples, const KalscopeReadings &readings) {
    const uint32_t length = samples < LEARNING ? 0 : (samples - LEARNING) / (GROUPS + 1);
    if (length < MIN_EACH || length > MAX_EACH) return false;
    memset((void *)this, 0, sizeof(*this));
    each = length;
    step = known_step = readings.step;
    lowest = readings.lowest;
    highest = readings.highest;
    before = NAN;
    state = MEASURING;
    return true;
  }

  // Takes one sample, NAN where none came; `state` says when it has ended.
  void take(float z) {
    if (state != MEASURING) return;
    const bool came = z - z == 0.0f;  // neither NAN nor infinite
    if (!came) {
      before = NAN;
      if (++missing > measured() / 10) state = MISSING;
    } else if (learned < LEARNING) {
      learn(z);
      return;
    } else {
      judge(z);
    }
    if (state != MEASURING || learned < LEARNING || ++place < each) return;
    place = 0;
    endGroup();
  }

  uint32_t rows() const { return LEARNING + (GROUPS + 1UL) * each; }
  uint16_t measured() const { return GROUPS * each; }

  State state = IDLE;
  float r;         // at the end: the variance of the noise, at least that of rounding to `step`
  float variance;  // about the straight line
  float step;      // the smallest distance of two readings, 0: none was seen
  uint16_t used, spikes, missing, cut_off;

 private:
  void learn(float z) {
    uint8_t at = learned++;
    for (; at > 0 && held[at - 1] > z; at--) held[at] = held[at - 1];
    held[at] = z;
    if (learned < LEARNING) return;
    level = centre = middle();
    for (at = 1; at < LEARNING; at++) sawStep(held[at] - held[at - 1]);
    for (at = 0; at < LEARNING; at++) {
      const float away = fabs(held[at] - level);
      uint8_t to = at;
      for (; to > 0 && held[to - 1] > away; to--) held[to] = held[to - 1];
      held[to] = away;
    }
    spread = middle();
  }

  float middle() const { return 0.5f * (held[LEARNING / 2 - 1] + held[LEARNING / 2]); }

  void sawStep(float distance) {
    distance = fabs(distance);
    if (distance > 0.0f && (step == 0.0f || distance < step)) step = distance;
  }

  // A reading far from the others is a spike; any other counts. `spread` is the median distance from `centre`, which
  // follows the readings: both are corrected by each, the first by ever less.
  void judge(float z) {
    const float off = z - centre, away = fabs(off);
    if (step == 0.0f) step = away;
    if (spread < 0.25f * step) spread = 0.25f * step;
    const float share = 1.0f / (LEARNING + ++judged), noise = 1.4826f * spread;
    const float limit = ($spike + 64.0f * share) * (noise > step ? noise : step);
    const float change = spread * (1.2f * share);
    spread = away > spread ? spread + change : spread - change;
    if (away > limit) {
      before = NAN;
      if (++spikes > measured() / 20) state = SPIKES;
      return;
    }
    centre = centre + 0.0625f * off;
    if (before == before) {
      const float jump = z - before;
      sawStep(jump);
      if (jump != 0.0f) changes++;
      jumps = jumps + jump * jump;
      pairs++;
    }
    before = z;
    if (z <= lowest || z >= highest) cut_off++;
    const float e = z - level, t = (place + 0.5f) / each + (group - (GROUPS / 2 + 1));
    const float terms[] = {t, t * t, e, t * e, e * e};
    for (uint8_t i = 0; i < 5; i++) sums[i] = sums[i] + terms[i];
    counted++;
  }

  // Groups are added up separately first, so that a sum of thousands keeps its last digits.
  void endGroup() {
    if (group == 0) {  // it has only shown how far the readings spread
      spikes = missing = cut_off = pairs = changes = 0;
      jumps = 0.0f;
    } else if (counted < 2) {
      state = TOO_FEW;
    } else {
      const float n = counted;
      held[group - 1] = sums[2] / n;
      held[GROUPS + group - 1] = (sums[4] - sums[2] * sums[2] / n) / (n - 1.0f);
      for (uint8_t i = 0; i < 5; i++) total[i] = total[i] + sums[i];
      used += counted;
    }
    memset(sums, 0, sizeof(sums));
    counted = 0;
    if (group++ == GROUPS && state == MEASURING) finish();
  }

  void finish() {
    const float n = used;
    const float mean_t = total[0] / n, mean_e = total[2] / n;
    const float tt = total[1] - total[0] * mean_t, te = total[3] - total[0] * mean_e;
    const float ee = total[4] - total[2] * mean_e;
    variance = (ee - te / tt * te) / (n - 2.0f);
    const float floor = step * step / 12.0f;
    r = variance > floor ? variance : floor;
    if (used < $min_readings) state = TOO_FEW;
    else if (cut_off > used / 100) state = CUT_OFF;
    else if (!(r - r == 0.0f && variance == variance)) state = TOO_LARGE;
    else if (r == 0.0f || (variance <= floor && known_step == 0.0f && changes < 16)) state = EQUAL;
    else if (isMoving(n)) state = MOVING;
    else if (variance > floor && isUneven(n)) state = UNEVEN;
    else if (variance > floor && isDependent(n)) state = DEPENDENT;
    else state = FOUND;
  }

  // Whether the means of the groups drift, or lie off a straight line.
  bool isMoving(float n) const {
    float mean = 0.0f, slope = 0.0f, squared = 0.0f;
    for (uint8_t i = 0; i < GROUPS; i++) {
      mean = mean + held[i];
      slope = slope + (i - 0.5f * (GROUPS - 1)) * held[i];
    }
    mean = mean / GROUPS;
    slope = slope / (GROUPS * (GROUPS * GROUPS - 1) / 12.0f);
    for (uint8_t i = 0; i < GROUPS; i++) {
      const float off = held[i] - mean - slope * (i - 0.5f * (GROUPS - 1));
      squared = squared + off * off;
    }
    if (squared * n / GROUPS / r > larger($wander_sure, n / 100.0f)) return true;
    return slope * slope * (GROUPS * GROUPS) > $drift_squared * r;
  }

  // Whether the variances of the groups differ more than by chance; coarse steps allow more.
  bool isUneven(float n) const {
    float least = held[GROUPS], most = least;
    for (uint8_t i = 1; i < GROUPS; i++) {
      const float one = held[GROUPS + i];
      if (one < least) least = one;
      if (one > most) most = one;
    }
    const float apart = (most - least) / variance;
    return apart * apart > larger(0.16f, $uneven_sure * (2.0f + step * step / variance) / n);
  }

  // Whether the squared distance of neighbours differs from twice the variance.
  bool isDependent(float n) const {
    const float off = jumps / pairs / (2.0f * variance) - 1.0f;
    return off * off > larger(0.01f, $sure_squared / n);
  }

  static float larger(float a, float b) { return a > b ? a : b; }

  float held[LEARNING];  // the first readings; then the means and the variances of the groups
  float known_step, level, centre, spread, lowest, highest, before, jumps, sums[5], total[5];
  uint32_t judged;
  uint16_t each, place, counted, pairs, changes;
  uint8_t learned, group;
};

#if defined(__GNUC__) && !defined(__clang__) && !defined(__AVR__)
#pragma GCC pop_options
#endif

#endif
