  // Other values while it runs: the constants follow by sums, products and quotients alone, so that every
  // processor computes the same bits. tau from 0.001 to 100000 samples, or 0.
  void setMomentum(float q, float tau) {
    tuning.q = q;
    tuning.momentum = tau;
    tuning.e = tuning.f = tuning.q12 = tuning.q22 = tuning.w0 = 0.0f;
    tuning.q11 = q;
    if (!(tau > 0.0f)) return;
    const float h = 1.0f / tau;
    float halved = h;
    uint8_t doublings = 0;
    for (; halved > 1.0f; doublings++) halved = halved * 0.5f;
    float power = halved, gone = halved;  // powers of h over their factorials, and their sum 1 - e
    float sum = 0.0f, both = 0.0f;
    for (uint8_t n = 2; n <= $last_power; n++) {
      power = power * -halved / n;
      gone = gone + power;
      sum = sum + both * power;
      both = both + both + 2.0f;
    }
    for (uint8_t i = 0; i < doublings; i++) gone = gone * (2.0f - gone);
    if (doublings > 0) sum = h - gone - 0.5f * gone * gone;
    tuning.w0 = 0.5f * q / tau;
    tuning.e = 1.0f - gone;
    tuning.f = tau * gone;
    tuning.q11 = q * tau * sum;
    tuning.q12 = 0.5f * q * gone * gone;
    tuning.q22 = tuning.w0 * gone * (2.0f - gone);
  }

