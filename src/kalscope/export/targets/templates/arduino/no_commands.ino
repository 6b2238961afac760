// Answers each line that arrives: these filters take no values while they run.
void listen() {
  static bool empty = true;
  while (Serial.available() > 0) {
    const char letter = Serial.read();
    const bool ends = letter == '\n' || letter == '\r';
    if (ends && !empty) {
      Serial.println(F("# not understood; these filters take no values while they run: export the sketch again"));
    }
    empty = ends;
  }
}

