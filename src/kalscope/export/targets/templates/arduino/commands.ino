void printBits(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof(bits));
  for (int8_t shift = 28; shift >= 0; shift -= 4) Serial.print((bits >> shift) & 15, HEX);
}

// As 1.234567e-5: print() alone would show 0.00.
void printSmall(float value) {
  int8_t exponent = 0;
  if (value > 0.0f && !isinf(value)) {
    for (; value >= 10.0f; exponent++) value /= 10.0f;
    for (; value < 1.0f; exponent--) value *= 10.0f;
  }
  Serial.print(value, 6);
  if (exponent != 0) {
    Serial.print('e');
    Serial.print(exponent);
  }
}

void answer(uint8_t channel) {
  const KalscopeTuning &tuning = filters[channel].tuning;
  Serial.print(F("# "));
  Serial.print(NAMES[channel]);
@chain   if (tuning.filter != KALSCOPE_KALMAN) {
@chain     Serial.println(F(" takes no values while it runs: export the sketch again to change it"));
@chain     return;
@chain   }
  Serial.print(F(" q="));
  printSmall(tuning.q);
  Serial.print(F(" r="));
  printSmall(tuning.r);
  Serial.print(F(" p="));
  printSmall(tuning.p0);
@momentum   Serial.print(F(" t="));
@momentum   printSmall(tuning.momentum);
@median   Serial.print(F(" m="));
@median   Serial.print(tuning.median);
  Serial.print(F(" bits="));
  printBits(tuning.q);
  Serial.print(',');
  printBits(tuning.r);
  Serial.print(',');
  printBits(tuning.p0);
@momentum   Serial.print(',');
@momentum   printBits(tuning.momentum);
  Serial.println();
}

@momentum // Whether float can hold the constants that follow from them.
@momentum bool fits(float q, float tau) {
@momentum   return tau == 0.0f || (tau >= 1e-3f && tau <= 1e5f && !isinf(0.5f * q / tau));
@momentum }
@momentum 
// Starts to use the value; false where the filter cannot work with it.
bool change(KalscopeFilter &filter, char what, float value) {
  KalscopeTuning &tuning = filter.tuning;
  if (what == '?') return true;
@chain   if (tuning.filter != KALSCOPE_KALMAN) return true;  // answered, and not changed
  if (!(value >= 0.0f) || (isinf(value) && what != 'p')) return false;
  if (what == 'p') {
    tuning.p0 = value;
    filter.restart();
    return true;
  }
@momentum   if (what == 't') {
@momentum     if (!fits(tuning.q, value)) return false;
@momentum     filter.setMomentum(tuning.q, value);
@momentum     return true;
@momentum   }
  if (value + (what == 'q' ? tuning.r : tuning.q) == 0.0f) return false;  // not both
@plain   (what == 'q' ? tuning.q : tuning.r) = value;
@momentum   if (what == 'q') {
@momentum     if (!fits(value, tuning.momentum)) return false;
@momentum     filter.setMomentum(value, tuning.momentum);
@momentum   } else {
@momentum     tuning.r = value;
@momentum   }
  return true;
}

@calibration void calibrate(uint8_t channel, float seconds);
@calibration void keep();
@calibration void forget();
@calibration 
void obey(char *line) {
@calibration   if (strcmp(line, "k") == 0) return keep();
@calibration   if (strcmp(line, "f") == 0) return forget();
  char *at, *end;
  const unsigned long only = strtoul(line, &at, 10);  // 0 where the line begins with a letter
  while (*at == ' ') at++;
  const char what = *at;
  const float value = strtod(what == '\0' ? at : at + 1, &end);
  const bool complete = what == '?' || (strchr("$letters", what) && what != '\0' && end > at + 1);
  bool done = complete && *end == '\0' && only <= CHANNELS;
  for (uint8_t i = 0; i < CHANNELS && done; i++) {
    if (only != 0 && only != i + 1u) continue;
@calibration     if (what == 'c') {
@calibration       done = value >= 0.0f && !isinf(value);
@calibration       if (done) calibrate(i, value);
@calibration       continue;
@calibration     }
    done = change(filters[i], what, value);
    if (done) answer(i);
  }
@plain   if (!done) Serial.println(F("# not understood; q VALUE, r VALUE (0 or more, not both 0), p VALUE (or inf), ${more}or ?"));
@momentum   if (!done) {
@momentum     Serial.print(F("# not understood; q VALUE, r VALUE (0 or more, not both 0), t VALUE (0, or 0.001 to 100000), "));
@momentum     Serial.println(F("p VALUE (or inf), ${more}or ?"));
@momentum   }
}

// Collects what has arrived, without waiting, and obeys each complete line.
void listen() {
  static char line[32];
  static uint8_t length = 0;
  while (Serial.available() > 0) {
    const char letter = Serial.read();
    if (letter != '\n' && letter != '\r') {
      line[length] = letter;
      if (length < sizeof(line) - 1) length++;
      continue;
    }
    line[length] = '\0';
    if (length == sizeof(line) - 1) line[0] = '!';  // too long: no command begins with this
    if (length > 0) obey(line);
    length = 0;
  }
}

