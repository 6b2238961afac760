$about//
// kalmanjs swaps the letters: its R is the process noise q, its Q the measurement noise r.
// It starts as a diffuse start does: the first sample sets x = z and p = r. By itself, a NaN makes it forget
// everything and start again; update() below predicts only, and adds a known start and the gate.
// Its last digits differ from those of Kalscope (about 1e-12 of the signal), because it multiplies by 1/s.
import KalmanFilter from "kalmanjs";

export const filters = {
$filters};

export function update(filter, z) {
  if (Number.isNaN(z)) {
    filter.cov += filter.R;
    return filter.x;
  }
  if (Number.isNaN(filter.x) && !Number.isNaN(filter.cov)) filter.x = z;
  const v = z - filter.x;
  const s = filter.cov + filter.R + filter.Q;
  if (v * v > filter.gate * s && filter.refused < 5) {
    filter.cov += filter.R;
    filter.refused += 1;
    return filter.x;
  }
  filter.refused = 0;
  return filter.filter(z);
}
