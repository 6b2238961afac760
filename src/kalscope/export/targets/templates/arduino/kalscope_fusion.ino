$about
//
// Reads $pin_words, fuses them into one value, and prints a line a row; lines that begin with # are remarks:
//   $columns
// Put this file and KalscopeFusion.h into one folder named kalscope_fusion, and open it in the Arduino IDE.
// It takes no commands while it runs: for other values export again.

#include "KalscopeFusion.h"

const unsigned long BAUD = 115200;
const unsigned long PERIOD_US = $period_us;  // between rows;$period_words
const uint8_t PINS[KALSCOPE_SENSORS] = {$pins};
KalscopeFusion fusion($first);

// What each sensor reads, as it was in the recording: $units. NAN where it has no reading now.
${unit_check}float readSensor(uint8_t sensor) { return analogRead(PINS[sensor]); }

${print_float}unsigned long due_us;    // when the next row must be taken
unsigned long left_out;  // rows that could not be taken in time
unsigned long said_ms;   // when that was last reported

void setup() {
  Serial.begin(BAUD);
  Serial.println(F("# $columns"));
  due_us = micros();
}

void loop() {
  const unsigned long late_us = micros() - due_us;
  if ((long)late_us < 0) return;
  left_out += late_us / PERIOD_US;
  due_us += (late_us / PERIOD_US + 1) * PERIOD_US;

  float readings[KALSCOPE_SENSORS];
  for (uint8_t i = 0; i < KALSCOPE_SENSORS; i++) readings[i] = readSensor(i);
  const float fused = fusion.update(readings);
  for (uint8_t i = 0; i < KALSCOPE_SENSORS; i++) {
    printFloat(readings[i]);
    Serial.print(',');
  }
  printFloat(fused);
  Serial.println();
  if (left_out > 0 && millis() - said_ms >= 1000) {
    Serial.print(F("# too slow: samples left out: "));
    Serial.println(left_out);
    left_out = 0;
    said_ms = millis();
  }
}
