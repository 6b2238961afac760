$about
//
// Reads $pin_words, filters, and prints a line a sample; lines that begin with # are remarks:
//   $columns
// Put this file and KalscopeFilter.h into one folder named kalscope_filter, and open it in the Arduino IDE.
//
// Lines it understands while it runs, in the unit above:
//   q 0.01     process noise; the filter goes on
//   r 4        measurement noise; the filter goes on
@momentum //   t 20       momentum in samples, 0.001 to 100000, or 0 for none; the filter goes on
//   p 1000     start variance, and start again; p inf: the first sample is the start
//   ?          which values are in use
// Each is answered by a # line with the values and their exact bits. Wait for it before the next: a board keeps
// 64 letters. All channels are meant; "2 q 0.01" means the second.

#include "KalscopeFilter.h"

const unsigned long BAUD = 115200;
const unsigned long PERIOD_US = $period_us;  // between samples;$period_words
const uint8_t PINS[] = {$pins};
const char *const NAMES[] = {$names};
KalscopeFilter filters[] = {$filters};
const uint8_t CHANNELS = sizeof(PINS);

// What the filter takes, in the unit it was tuned in: $units. NAN where there is no sample.
${unit_check}float readSensor(uint8_t channel) { return analogRead(PINS[channel]); }

${print_float}${commands}unsigned long due_us;    // when the next sample must be taken
unsigned long left_out;  // samples that could not be taken in time
unsigned long said_ms;   // when that was last said

void setup() {
  Serial.begin(BAUD);
  Serial.println(F("# $columns"));
  due_us = micros();
}

void loop() {
  listen();
  const unsigned long late_us = micros() - due_us;
  if ((long)late_us < 0) return;
  left_out += late_us / PERIOD_US;
  due_us += (late_us / PERIOD_US + 1) * PERIOD_US;

  float samples[CHANNELS];
  for (uint8_t i = 0; i < CHANNELS; i++) samples[i] = readSensor(i);
  for (uint8_t i = 0; i < CHANNELS; i++) {
    if (i > 0) Serial.print(',');
    printFloat(samples[i]);
    Serial.print(',');
    printFloat(filters[i].update(samples[i]));
  }
  Serial.println();
  if (left_out > 0 && millis() - said_ms >= 1000) {
    Serial.print(F("# too slow: samples left out: "));
    Serial.println(left_out);
    left_out = 0;
    said_ms = millis();
  }
}
