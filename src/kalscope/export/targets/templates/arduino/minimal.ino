$about
//
// Reads $pin_words, filters, and prints a line a sample: $columns
// Put this file and KalscopeFilter.h into one folder named kalscope_filter, and open it in the Arduino IDE.

#include "KalscopeFilter.h"

const unsigned long PERIOD_US = $period_us;  // between samples;$period_words
const uint8_t PINS[] = {$pins};
KalscopeFilter filters[] = {$filters};
unsigned long due_us;  // when the next sample must be taken

// What the filter takes, in the unit it was tuned in: $units. NAN where there is no sample.
${unit_check}float readSensor(uint8_t channel) { return analogRead(PINS[channel]); }

void setup() {
  Serial.begin(115200);
  due_us = micros();
}

void loop() {
  if ((long)(micros() - due_us) < 0) return;
  due_us += PERIOD_US;
  for (uint8_t i = 0; i < sizeof(PINS); i++) {
    const float raw = readSensor(i);
    if (i > 0) Serial.print(',');
    Serial.print(raw);
    Serial.print(',');
    Serial.print(filters[i].update(raw));
  }
  Serial.println();
}
