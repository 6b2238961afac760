$about
//
// Reads $pin_words, filters, and prints a line a sample; lines that begin with # are remarks:
//   $columns
// Put this file and KalscopeFilter.h into one folder named kalscope_filter, and open it in the Arduino IDE.
@calibration // KalscopeCalibration.h belongs there too.
@kalman //
@kalman // Commands while it runs, in the unit above:
@kalman //   q 0.01     process noise; the filter continues
@kalman //   r 4        measurement noise; the filter continues
@momentum //   t 20       momentum in samples, 0.001 to 100000, or 0 for none; the filter continues
@kalman //   p 1000     start variance, and start again; p inf: the first sample is the start
@kalman //   ?          which values are in use
@calibration //   c 10       measure r for 10 s while the input does not change, and use it, with the q of the same
@calibration //              lag; c 0 cancels it
@calibration //   k          keep the values in use in the EEPROM, for the next start; f forgets them
@kalman // Each is answered by a # line with the values and their exact bits. Wait for it before the next: a board keeps
@kalman // 64 characters. A command is for all channels; "2 q 0.01" is for the second.

@calibration #include <EEPROM.h>
@calibration 
#include "KalscopeFilter.h"
@calibration #include "KalscopeCalibration.h"

const unsigned long BAUD = 115200;
const unsigned long PERIOD_US = $period_us;  // between samples;$period_words
const uint8_t PINS[] = {$pins};
const char *const NAMES[] = {$names};
KalscopeFilter filters[] = {$filters};
const uint8_t CHANNELS = sizeof(PINS);

@calibration // When r is measured without a command; a line such as "#define KALSCOPE_CALIBRATE_PIN 2" may come above.
@calibration #ifndef KALSCOPE_CALIBRATE_AT_START
@calibration #define KALSCOPE_CALIBRATE_AT_START 0  // 1: at every start
@calibration #endif
@calibration #ifndef KALSCOPE_CALIBRATE_PIN
@calibration #define KALSCOPE_CALIBRATE_PIN -1  // a pin: at a start while it is connected to ground; -1: none
@calibration #endif
@calibration #ifndef KALSCOPE_CALIBRATE_S
@calibration #define KALSCOPE_CALIBRATE_S 10  // for how many seconds, then
@calibration #endif
@calibration #ifndef KALSCOPE_CALIBRATE_KEEP
@calibration #define KALSCOPE_CALIBRATE_KEEP 0  // 1: what was measured is kept in the EEPROM, as by k
@calibration #endif
@calibration 
// What the filter takes, in the unit it was tuned in: $units. NAN where there is no sample.
${unit_check}float readSensor(uint8_t channel) { return analogRead(PINS[channel]); }
@calibration 
@calibration // What is known about these readings: their step (0: not known), lowest and highest (-INFINITY, INFINITY: not known).
@calibration // The highest is 1023 on an Uno, 4095 where the converter has 12 bits.
@calibration const KalscopeReadings KALSCOPE_READINGS = {$readings};

${print_float}${commands}${calibrate}unsigned long due_us;    // when the next sample must be taken
unsigned long left_out;  // samples that could not be taken in time
unsigned long said_ms;   // when that was last reported

void setup() {
  Serial.begin(BAUD);
@calibration   startCalibrated();
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
@calibration   measure(samples);
  if (left_out > 0 && millis() - said_ms >= 1000) {
    Serial.print(F("# too slow: samples left out: "));
    Serial.println(left_out);
    left_out = 0;
    said_ms = millis();
  }
}
