// Prints as many digits as it takes to read the same float back, for values of 1/16 and more; in whole numbers.
void printFloat(float value) {
  if (value < 0.0f) {
    Serial.print('-');
    value = -value;
  }
  if (!(value < 4.0e9f)) {  // NAN as well
    Serial.print(value);
    return;
  }
  const uint32_t whole = value;
  Serial.print(whole);
  uint32_t rest = (value - whole) * 268435456.0f;  // in units of 1/2^28
  uint32_t enough = 4;                             // a quarter of the distance to the next float, in the same unit
  for (uint32_t size = whole; size > 0 && enough < 134217728; size >>= 1) enough <<= 1;
  for (uint32_t size = rest; whole == 0 && enough > 1 && size < 134217728; size <<= 1) enough >>= 1;
  Serial.print('.');
  do {
    rest *= 10;
    enough *= 10;
    Serial.print((char)('0' + (rest >> 28)));
    rest &= 268435455;
  } while (rest >= enough);
}

