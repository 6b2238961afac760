// The scalar Kalman noise filter as it was tuned; needs nothing but JavaScript: Node.js, Deno, a browser.
//
//   import { filters } from "./kalscope_filter.mjs";
//   const filtered = filters.$first.update(raw);      // NaN where a sample is missing
//
$about
export class KalmanFilter {
@plain   constructor({ q, r, p0 = Infinity, x0 = NaN, gate = Infinity }) {
@plain     Object.assign(this, { q, r, p: p0, x: x0, gate, k: 0, refused: 0 });
@momentum   // The second state is the velocity, per sample; w is its variance, g its covariance with x.
@momentum   constructor({ q, r, p0 = Infinity, x0 = NaN, gate = Infinity, momentum = 0, e = 0, f = 0, q11 = q, q12 = 0, q22 = 0, w0 = 0 }) {
@momentum     Object.assign(this, { q, r, p: p0, x: x0, gate, momentum, e, f, q11, q12, q22, k: 0, refused: 0 });
@momentum     Object.assign(this, { velocity: 0, g: 0, w: w0 });
  }

  // The filtered value after the sample z; NaN is a missing sample: predict only.
  update(z) {
@plain     this.p = this.p + this.q;
@momentum     const { e, f, g, w } = this;
@momentum     this.x = this.x + f * this.velocity;
@momentum     this.velocity = e * this.velocity;
@momentum     this.p = this.p + f * (2 * g + f * w) + this.q11;
@momentum     this.g = e * (g + f * w) + this.q12;
@momentum     this.w = e * e * w + this.q22;
    this.k = 0;
    if (Number.isNaN(z)) return this.x;
    if (this.p === Infinity) { // the first sample of an unknown start
@plain       Object.assign(this, { x: z, p: this.r, k: 1, refused: 0 });
@momentum       Object.assign(this, { x: z, p: this.r, g: 0, k: 1, refused: 0 });
      return z;
    }
    const v = z - this.x;
    const s = this.p + this.r;
    if (v * v > this.gate * s && this.refused < 5) {
      this.refused += 1;
      return this.x;
    }
    this.k = this.p / s;
@momentum     const share = this.g / s;
@momentum     this.w = this.w - share * this.g;
@momentum     this.g = share * this.r;
@momentum     if (!Number.isNaN(this.x)) this.velocity = this.velocity + share * v;
    this.refused = 0;
    this.x = Number.isNaN(this.x) ? z : this.x + this.k * v;
    this.p = this.k * this.r;
    return this.x;
  }
}

export const filters = {
$filters};
