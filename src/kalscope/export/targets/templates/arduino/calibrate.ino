KalscopeCalibration calibrations[CHANNELS];
const float RATIOS[] = {$ratio_names};  // q over r

void remark(uint8_t channel, const __FlashStringHelper *text) {
  Serial.print(F("# "));
  Serial.print(NAMES[channel]);
  Serial.print(text);
}

// Begins to measure; 0 seconds: ends it.
void calibrate(uint8_t channel, float seconds) {
  KalscopeCalibration &one = calibrations[channel];
  const float rate = 1e6f / PERIOD_US, rows = seconds * rate + 0.5f;
  const bool many = rows >= KalscopeCalibration::MAX_ROWS + 1.0f;
  if (seconds == 0.0f) {
    one.state = KalscopeCalibration::IDLE;
    remark(channel, F(" not calibrated: cancelled\r\n"));
  } else if (!many && one.start(rows, KALSCOPE_READINGS)) {
    remark(channel, F(" calibrating rows="));
    Serial.println(one.rows());
  } else {
    const float limit = 100.0f * (many ? KalscopeCalibration::MAX_ROWS : KalscopeCalibration::MIN_ROWS) / rate;
    remark(channel, many ? F(" not calibrated: too long; ") : F(" not calibrated: too short; "));
    Serial.print(0.01f * (many ? floor(limit) : ceil(limit)));
    Serial.println(many ? F(" s at most") : F(" s at least"));
  }
}

void sayCount(const __FlashStringHelper *before, uint16_t count) {
  Serial.print(before);
  Serial.print(count);
}

void sayShare(const __FlashStringHelper *before, uint16_t count, uint16_t all, const __FlashStringHelper *after) {
  sayCount(before, count);
  sayCount(F(" of "), all);
  Serial.println(after);
}

void sayWhyNot(uint8_t channel) {
  typedef KalscopeCalibration Why;
  const KalscopeCalibration &one = calibrations[channel];
  remark(channel, F(" not calibrated: "));
  if (one.state == Why::MISSING) return sayShare(F("no reading in "), one.missing, one.measured(), F(" samples"));
  if (one.state == Why::SPIKES) return sayShare(F("spikes in "), one.spikes, one.measured(), F(" samples"));
  if (one.state == Why::CUT_OFF) return sayShare(F(""), one.cut_off, one.used, F(" readings at an end of the range"));
  Serial.println(one.state == Why::TOO_FEW  ? F("too few readings")
                 : one.state == Why::EQUAL  ? F("nearly all readings are equal")
                 : one.state == Why::MOVING ? F("the level moves")
                 : one.state == Why::UNEVEN ? F("the noise is uneven")
                 : one.state == Why::DEPENDENT
                     ? F("neighbouring readings depend on each other")
                     : F("float32 cannot hold r and q"));
}

void sayWhat(uint8_t channel) {
  const KalscopeCalibration &one = calibrations[channel];
  const KalscopeTuning &tuning = filters[channel].tuning;
  if (one.r > one.variance) remark(channel, F(" hardly changes: r is the rounding to its step\r\n"));
  remark(channel, F(" calibrated r="));
  printSmall(tuning.r);
  Serial.print(F(" q="));
  printSmall(tuning.q);
  sayCount(F(" n="), one.used);
  sayCount(F(" spikes="), one.spikes);
  sayCount(F(" missing="), one.missing);
  Serial.print(F(" step="));
  printSmall(one.step);
  Serial.print(F(" bits="));
  printBits(tuning.r);
  Serial.print(',');
  printBits(tuning.q);
  Serial.print(',');
  printBits(one.step);
  Serial.println();
}

bool isNormal(float value) { return value >= 1.17549435e-38f && value - value == 0.0f; }

// Starts to use r, and the q of the same lag; false where float cannot hold them.
bool useMeasured(KalscopeFilter &filter, float r, float q) {
  if (!isNormal(r) || (q != 0.0f && !isNormal(q)) || !isNormal(q + r)) return false;
@momentum   if (!fits(q, filter.tuning.momentum)) return false;
@momentum   filter.setMomentum(q, filter.tuning.momentum);
@plain   filter.tuning.q = q;
  filter.tuning.r = r;
  return true;
}

void keep();

// Passes each sample to the channels that measure, and reports what they found.
void measure(const float *samples) {
  bool found = false;
  for (uint8_t i = 0; i < CHANNELS; i++) {
    KalscopeCalibration &one = calibrations[i];
    one.take(samples[i]);
    if (one.state <= KalscopeCalibration::MEASURING) continue;
    if (one.state == KalscopeCalibration::FOUND && !useMeasured(filters[i], one.r, RATIOS[i] * one.r)) {
      one.state = KalscopeCalibration::TOO_LARGE;
    }
    const bool good = one.state == KalscopeCalibration::FOUND;
    good ? sayWhat(i) : sayWhyNot(i);
    found = found || good;
    one.state = KalscopeCalibration::IDLE;
  }
  if (found && KALSCOPE_CALIBRATE_KEEP) keep();
}

// ---- What is kept in the EEPROM: the stamp of this export, the values in use of all channels, a checksum.

const uint16_t KEPT = CHANNELS * sizeof(KalscopeTuning);
const uint32_t NOTHING_KEPT = 0xFFFFFFFF;

#if defined(ESP8266) || defined(ESP32) || defined(ARDUINO_ARCH_RP2040)  // flash that emulates an EEPROM
#define KALSCOPE_EEPROM_BEGIN EEPROM.begin(KEPT + 8)
#define KALSCOPE_EEPROM_DONE EEPROM.commit()
#else
#define KALSCOPE_EEPROM_BEGIN
#define KALSCOPE_EEPROM_DONE
#endif

uint8_t &inUse(uint16_t i) { return ((uint8_t *)&filters[i / sizeof(KalscopeTuning)].tuning)[i % sizeof(KalscopeTuning)]; }

void store(uint16_t at, uint8_t value) {
  if (EEPROM.read(at) != value) EEPROM.write(at, value);  // each write wears a cell
}

void storeWord(uint16_t at, uint32_t value) {
  for (uint8_t i = 0; i < 4; i++) store(at + i, value >> 8 * i);
}

uint32_t wordAt(uint16_t at) {
  uint32_t value = 0;
  for (uint8_t i = 4; i-- > 0;) value = value << 8 | EEPROM.read(at + i);
  return value;
}

// CRC-32 of what is kept.
uint32_t checksum() {
  uint32_t sum = KALSCOPE_STAMP;
  for (uint16_t i = 0; i < KEPT; i++) {
    sum ^= EEPROM.read(4 + i);
    for (uint8_t bit = 0; bit < 8; bit++) sum = sum & 1 ? sum >> 1 ^ 0xEDB88320 : sum >> 1;
  }
  return sum;
}

void keep() {
  bool held = true;
  storeWord(0, KALSCOPE_STAMP);
  for (uint16_t i = 0; i < KEPT; i++) store(4 + i, inUse(i));
  storeWord(4 + KEPT, checksum());
  KALSCOPE_EEPROM_DONE;
  for (uint16_t i = 0; i < KEPT; i++) held = held && EEPROM.read(4 + i) == inUse(i);
  if (!held || wordAt(0) != KALSCOPE_STAMP || wordAt(4 + KEPT) != checksum()) {
    Serial.println(F("# not kept: the EEPROM does not hold what was written"));
    return;
  }
  sayCount(F("# kept "), CHANNELS);
  Serial.println(CHANNELS == 1 ? F(" channel") : F(" channels"));
}

void forget() {
  storeWord(0, NOTHING_KEPT);
  KALSCOPE_EEPROM_DONE;
  Serial.println(F("# forgotten"));
}

// Starts to use what is kept, if it is intact and from this export.
void useKept() {
  KALSCOPE_EEPROM_BEGIN;
  const uint32_t stamp = wordAt(0);
  if (stamp == NOTHING_KEPT) return;
  if (stamp != KALSCOPE_STAMP) {
    Serial.println(F("# kept values refused: they are another sketch's"));
  } else if (wordAt(4 + KEPT) != checksum()) {
    Serial.println(F("# kept values refused: they are damaged"));
  } else {
    for (uint16_t i = 0; i < KEPT; i++) inUse(i) = EEPROM.read(4 + i);
    Serial.println(F("# kept values are in use"));
    for (uint8_t i = 0; i < CHANNELS; i++) {
      filters[i].restart();
      answer(i);
    }
  }
}

void startCalibrated() {
  useKept();
  bool asked = KALSCOPE_CALIBRATE_AT_START;
#if KALSCOPE_CALIBRATE_PIN >= 0
  pinMode(KALSCOPE_CALIBRATE_PIN, INPUT_PULLUP);
  delay(1);
  asked = asked || digitalRead(KALSCOPE_CALIBRATE_PIN) == LOW;
#endif
  for (uint8_t i = 0; i < CHANNELS && asked; i++) calibrate(i, KALSCOPE_CALIBRATE_S);
}

