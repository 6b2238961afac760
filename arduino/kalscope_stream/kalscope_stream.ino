// kalscope_stream: sends sensor readings to Kalscope, over the USB cable, at a steady rate.
//
// 1. Set the values below. 2. Upload. 3. Close the Serial Monitor. 4. Open the port in Kalscope at the same BAUD.
// How to wire a sensor, and more on each step: docs/live-board.md of Kalscope.
//
// One line per sample, the name of each channel before its value, so Kalscope can start listening at any moment:
//   light:512*72
// Lines that begin with # are remarks. Runs on every board that has analogRead() and micros().

const unsigned long BAUD = 115200;             // the same number as in Kalscope
const unsigned long SAMPLES_PER_SECOND = 200;  // 1 to 1000 or so: the board says when it cannot keep up
const bool CHECKSUM = true;                    // *72 ends each line: damaged lines are rejected
const bool BOARD_TIME = false;                 // time_us: begins each line: the board's clock, in microseconds

struct Channel {
  const char *name;  // no comma or colon; the unit may follow: "heat [mV]"
  uint8_t pin;
};

const Channel CHANNELS[] = {
    {"A0", A0},
    // {"A1", A1},
};
const uint8_t CHANNEL_COUNT = sizeof(CHANNELS) / sizeof(CHANNELS[0]);

// Prints to the serial port and computes the checksum: all bytes of the line, XORed.
class CheckedLine : public Print {
 public:
  using Print::write;
  size_t write(uint8_t letter) override {
    sum ^= letter;
    return Serial.write(letter);
  }
  uint8_t sum = 0;
};

unsigned long due_us;       // when the next sample must be taken
unsigned long fraction;     // of a microsecond, in 1/SAMPLES_PER_SECOND: 300 samples/s do not divide a second
unsigned long left_out;     // samples that could not be taken in time
unsigned long reported_ms;  // when that was last reported

// Counts from when the sample was due, not from when it was taken: delays do not add up.
void nextDue() {
  due_us += 1000000 / SAMPLES_PER_SECOND;
  fraction += 1000000 % SAMPLES_PER_SECOND;
  if (fraction >= SAMPLES_PER_SECOND) {
    fraction -= SAMPLES_PER_SECOND;
    due_us++;
  }
}

void sendSample() {
  const unsigned long now_us = micros();
  int values[CHANNEL_COUNT];  // all are read before the first is sent: sending may have to wait
  for (uint8_t i = 0; i < CHANNEL_COUNT; i++) values[i] = analogRead(CHANNELS[i].pin);

  CheckedLine line;
  const char *between = "";
  if (BOARD_TIME) {
    line.print(F("time_us:"));
    line.print(now_us);
    between = ",";
  }
  for (uint8_t i = 0; i < CHANNEL_COUNT; i++) {
    line.print(between);
    line.print(CHANNELS[i].name);
    line.print(':');
    line.print(values[i]);
    between = ",";
  }
  if (CHECKSUM) {
    Serial.print(line.sum < 16 ? F("*0") : F("*"));
    Serial.print(line.sum, HEX);
  }
  Serial.println();
}

void reportLeftOut() {
  Serial.print(F("# too slow: "));
  Serial.print(left_out);
  Serial.println(F(" samples left out; raise BAUD, or lower SAMPLES_PER_SECOND"));
  left_out = 0;
  reported_ms = millis();
}

void setup() {
  Serial.begin(BAUD);
  Serial.println(F("# kalscope_stream"));
  due_us = micros();
}

void loop() {
  if ((long)(micros() - due_us) < 0) return;  // in this form it also works when micros() wraps around to 0
  while (micros() - due_us >= 1000000 / SAMPLES_PER_SECOND) {  // late by a whole sample: leave that one out
    nextDue();
    left_out++;
  }
  sendSample();
  nextDue();
  if (left_out > 0 && millis() - reported_ms >= 1000) reportLeftOut();
}
