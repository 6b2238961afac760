// The Kalman filter of several sensors as it was tuned; needs nothing but JavaScript: Node.js, Deno, a browser.
//
//   import { fusion } from "./kalscope_fusion.mjs";
//   const fused = fusion.update([$words]);      // NaN where a sensor has no reading
//
$about
export class KalmanFusion {
@plain   constructor({ q, r, offset, gain, p0 = Infinity, x0 = NaN, gate = Infinity }) {
@plain     Object.assign(this, { q, r, offset, gain, p: p0, x: x0, gate });
@momentum   // The second state is the velocity, per sample; w is its variance, g its covariance with x.
@momentum   constructor({ q, r, offset, gain, momentum, e, f, q11, q12, q22, w0, p0 = Infinity, x0 = NaN, gate = Infinity }) {
@momentum     Object.assign(this, { q, r, offset, gain, momentum, e, f, q11, q12, q22, p: p0, x: x0, gate });
@momentum     Object.assign(this, { velocity: 0, g: 0, w: w0 });
    Object.assign(this, { k: r.map(() => 0), refused: r.map(() => 0) });
  }

  // The fused value after a row, one reading a sensor; NaN where a sensor has none.
  update(readings) {
@plain     this.p = this.p + this.q;
@momentum     const { e, f, g, w } = this;
@momentum     this.x = this.x + f * this.velocity;
@momentum     this.velocity = e * this.velocity;
@momentum     this.p = this.p + f * (2 * g + f * w) + this.q11;
@momentum     this.g = e * (g + f * w) + this.q12;
@momentum     this.w = e * e * w + this.q22;
    readings.forEach((z, i) => {
      this.k[i] = 0;
      if (!Number.isNaN(z)) this.take(i, (z - this.offset[i]) / this.gain[i]);
    });
    return this.x;
  }

  // The update with one reading, on the scale of x; r is on that scale too.
  take(i, z) {
    if (this.p === Infinity) { // the first reading of an unknown start
      [this.x, this.p, this.k[i], this.refused[i]] = [z, this.r[i], 1, 0];
@momentum       this.g = 0;
      return;
    }
    const starts = Number.isNaN(this.x);
    const v = z - this.x;
    const s = this.p + this.r[i];
    if (s === 0 && !starts) return; // the value and the reading both claim to be exact: keep the value
    if (v * v > this.gate * s && this.refused[i] < 5) {
      this.refused[i] += 1;
      return;
    }
    this.k[i] = s > 0 ? this.p / s : 0;
@momentum     const share = s > 0 ? this.g / s : 0;
@momentum     this.w = this.w - share * this.g;
@momentum     this.g = share * this.r[i];
@momentum     if (!starts) this.velocity = this.velocity + share * v;
    this.refused[i] = 0;
    this.x = starts ? z : this.x + this.k[i] * v;
    this.p = this.k[i] * this.r[i];
  }
}

// r is over gain^2, on the scale of the fused value.
export const fusion = new KalmanFusion({
$values});
