// What the page computes beside the exported filter: constants, lag and noise, best fit, tables, code. No page here.

const SERIES = [-510 / 3628800, 254 / 362880, -126 / 40320, 62 / 5040, -30 / 720, 7 / 60, -0.25, 1 / 3];

/** The constants of one sample period, as `step_constants` and `transition` of the program. */
function stepConstants(q, tau) {
  if (!(tau > 0)) return { momentum: 0, e: 0, f: 0, q11: q, q12: 0, q22: 0, w0: 0 };
  const h = 1 / tau;
  const u = -Math.expm1(-h);
  const series = SERIES.reduce((sum, factor) => factor + sum * h, 0);
  const a = h < 0.1 ? h * h * h * series : h - 2 * u - 0.5 * Math.expm1(-2 * h);
  const e = Math.exp(-h);
  const [q12, q22] = [0.5 * q * u * u, (-0.5 * q / tau) * Math.expm1(-2 * h)];
  return { momentum: tau, e: e > 1.2e-38 ? e : 0, f: tau * u, q11: q * tau * a, q12, q22, w0: (0.5 * q) / tau };
}

/** The exported filter with these parameters; null is an automatic start, or no gate. */
function filterOf({ q, r, p0, x0, gate, momentum }) {
  const start = { p0: p0 ?? Infinity, x0: x0 ?? NaN, gate: gate ?? Infinity };
  return new KalmanFilter({ q, r, ...start, ...stepConstants(q, momentum) });
}

const filtered = (z, params, filter = filterOf(params)) => Float64Array.from(z, (sample) => filter.update(sample));

/** Gain, lag in samples and the share of white noise that is left (standard deviation), once the filter has settled. */
function settled({ q, r, momentum }) {
  if (q === 0) return { gain: 0, lag: Infinity, noise: 0 };
  if (r === 0) return { gain: 1, lag: 0, noise: 1 };
  const [rootQ, rootR] = [Math.sqrt(q), Math.sqrt(r)];
  const widest = rootQ + Math.hypot(rootQ, 2 * rootR);
  const gain = (2 * rootQ) / widest;
  if (momentum > 0) return settledWithMomentum(q / r, momentum);
  return { gain, lag: 2 * (rootR / rootQ) * (rootR / widest), noise: Math.sqrt(gain / (2 - gain)) };
}

/** The equations of `WithMomentum` in filtering/steady.py, solved for the reach R = K + tau L by bisection. */
function settledWithMomentum(ratio, tau) {
  const [h, e, forgotten] = [1 / tau, Math.exp(-1 / tau), -Math.expm1(-1 / tau)];
  const series = [110, 72, 42, 20].reduce((sum, n) => 1 + (h * h * sum) / n, 1); // sinh h - h = h^3/6 (1 + h^2/20 ...)
  const bend = tau * (h < 1 ? (e * h * h * h * series) / 6 : -0.5 * Math.expm1(-2 * h) - h * e);
  const gainOf = (reach) => {
    const linear = forgotten * (1 + e + e * reach);
    const right = reach * (forgotten * (1 + e) - bend * reach);
    return right > 0 ? (2 * right) / (linear + Math.sqrt(linear * linear + 4 * e * e * right)) : 1;
  };
  let [low, high] = [-60, 0]; // decades of R/sqrt(ratio)
  const reachAt = (decades) => Math.sqrt(ratio) * 10 ** decades;
  for (let i = 0; i < 64; i++) {
    const reach = reachAt(0.5 * (low + high));
    if (reach * reach > ratio * (1 - gainOf(reach))) high = 0.5 * (low + high); else low = 0.5 * (low + high);
  }
  const reach = reachAt(low);
  const gain = gainOf(reach);
  const [product, both] = [forgotten * reach, 1 + (e * reach * reach) / ratio];
  const variance = product * both + 2 * gain * (gain - product);
  return { gain, lag: reach / ratio, noise: Math.sqrt(variance / ((forgotten + e * gain) * (2 * both - product))) };
}

/** q of the filter with this lag in samples; r and momentum stay. */
function qForLag(lag, { r, momentum }) {
  let [low, high] = [-30, 30]; // decades of q/r
  for (let i = 0; i < 60; i++) {
    const middle = 0.5 * (low + high);
    if (settled({ q: 10 ** middle, r: 1, momentum }).lag > lag) low = middle; else high = middle;
  }
  return r * 10 ** (0.5 * (low + high));
}

/** Log-likelihood of q/r = ratio with r at its maximum, and that r; the first sample is the start. */
function likelihood(z, ratio) {
  let [x, p, n, squares, logs] = [NaN, 1, 0, 0, 0];
  for (const sample of z) {
    if (Number.isNaN(x)) { x = sample; continue; }
    p += ratio;
    if (Number.isNaN(sample)) continue;
    const s = p + 1;
    const v = sample - x;
    squares += (v * v) / s;
    logs += Math.log(s);
    n += 1;
    x += (p / s) * v;
    p /= s;
  }
  return { r: squares / n, value: -0.5 * (n * Math.log(squares / n) + logs) };
}

/** The most likely q and r without momentum; null where the record has no noise that a filter could remove. */
function bestFit(z) {
  const at = (decades) => likelihood(z, 10 ** decades).value;
  const grid = Array.from({ length: 47 }, (_, i) => -12 + 0.4 * i);
  const values = grid.map(at);
  const best = values.indexOf(Math.max(...values));
  if (best < 1 || best > grid.length - 2) return null;
  let [low, high] = [grid[best - 1], grid[best + 1]];
  for (let i = 0; i < 45; i++) {
    const [left, right] = [low + (high - low) / 3, high - (high - low) / 3];
    if (at(left) > at(right)) high = right; else low = left;
  }
  const ratio = 10 ** (0.5 * (low + high));
  const { r } = likelihood(z, ratio);
  return r > 0 && ratio < 1e3 ? { q: r * ratio, r } : null;
}

/** A start where nothing can be fitted: a lag of 5 samples. */
function harmless(z) {
  const { r } = likelihood(z, 1 / 30);
  return r > 0 && r < Infinity ? { q: r / 30, r } : { q: 1 / 30, r: 1 };
}

// Simple tables.

const READS = "a row for each sample, numbers between commas, semicolons, tabs or blanks, one line of names above them";
const SECONDS = { ns: 1e-9, us: 1e-6, µs: 1e-6, ms: 1e-3, s: 1, sec: 1, seconds: 1, millis: 1e-3, micros: 1e-6 };

/** Names, units and columns of a table; throws an Error that says what must hold. */
function readTable(text) {
  const isData = (line) => line.trim() && !/^\s*(#|%|\/\/)/.test(line);
  const lines = text.replace(/^\uFEFF/, "").split(/\r\n|\r|\n/).filter(isData);
  const middle = lines.slice(lines.length >> 1, (lines.length >> 1) + 50);
  const marks = [/\t/, /;/, /,/, /\s+/];
  const split = (line, mark) => (mark.source === "\\s+" ? line.trim() : line).split(mark);
  const width = (mark) => { // cells of each line, 0 where the lines differ
    const widths = new Set(middle.map((line) => split(line, mark).length));
    return widths.size === 1 ? [...widths][0] : 0;
  };
  const mark = marks.find((one) => width(one) > 1) ?? /;/;
  const isComma = mark.source !== "," && middle.some((line) => /\d,\d/.test(line));
  const cells = (line) => split(line, mark).map((cell) => cell.trim().replace(/^"(.*)"$/, "$1"));
  const isMissing = (cell) => /^([-+]?(nan|inf|infinity)|na|null|none|)$/i.test(cell);
  const number = (cell) => (isMissing(cell) ? NaN : Number(isComma ? cell.replace(",", ".") : cell));
  const isText = (cell) => !isMissing(cell) && !Number.isFinite(number(cell));
  const hasNames = lines.length > 1 && cells(lines[0]).some(isText);
  const rows = lines.slice(hasNames ? 1 : 0).map(cells);
  const names = cells(lines[0] ?? "").map((cell, i) => (hasNames && cell) || `column ${i + 1}`);
  const good = rows.filter((row) => row.length === names.length && !row.some(isText));
  if (rows.length < 3 || good.length < 0.98 * rows.length) {
    const got = `${rows.length - good.length} of ${rows.length} rows are not`;
    throw new Error(`The table must have ${READS} (${got}). Kalscope reads dates, instruments and most other logs.`);
  }
  return withTime(names, names.map((_, i) => Float64Array.from(good, (row) => number(row[i]))));
}

const UNIT = /\s*[([]([^)\]]*)[)\]]\s*$/;
const TIME = /^(t|x|time|date|year|index|sample|stamp|millis|micros)(\b|_)/i;

/** Takes out the column of time: the first that always rises and is called so, or rises in nearly even steps. */
function withTime(names, columns) {
  const isTime = (column, i) => {
    const steps = column.slice(1).map((value, k) => value - column[k]);
    const [least, most] = [steps.reduce((a, b) => Math.min(a, b)), steps.reduce((a, b) => Math.max(a, b))];
    return least > 0 && (TIME.test(names[i]) || most < 1.5 * least);
  };
  const at = columns.length > 1 ? columns.findIndex(isTime) : -1;
  const unitOf = (name) => UNIT.exec(name)?.[1].trim() ?? "";
  const named = names.map((name, i) => ({ name: name.replace(UNIT, "") || name, unit: unitOf(name), z: columns[i] }));
  const channels = named.filter((_, i) => i !== at);
  const word = at < 0 ? "" : unitOf(names[at]) || /(millis|micros|ms|us|s)$/i.exec(names[at])?.[1].toLowerCase();
  if (!(word in SECONDS)) return { period: null, time: null, channels };
  const time = columns[at].map((value) => SECONDS[word] * (value - columns[at][0]));
  return { period: time[time.length - 1] / (time.length - 1), time, channels };
}

// Code to copy: the same filter in a few lines.

const GATE_IN_C = "if ((z - x) * (z - x) > gate * (p + r) && refused++ < 5) return x;  // a spike\n  refused = 0;\n  ";
const C = ({ about, type, constants, variables, start, predict, correct, gated }) => `// ${about}
#include <math.h>
static const ${type} ${constants};
static ${type} ${variables};

${type} kalman(${type} z) {
  ${predict.map((line) => `${line};`).join("\n  ")}
  if (isnan(z)) return x;  // no sample
  if (isnan(x)) {  // the first sample is the start
    ${start.map((line) => `${line};`).join("\n    ")}
    return x;
  }
  ${gated ? GATE_IN_C : ""}${correct.map((line) => `${/^[kl] =/.test(line) ? `${type} ` : ""}${line};`).join("\n  ")}
  return x;
}
`;

const IS_SPIKE = "if (z - x) ** 2 > gate * (p + r) and refused < 5:  # a spike";
const GATE_IN_PYTHON = [IS_SPIKE, "    refused += 1", "    return x", "refused = 0", ""].join("\n    ");
const PYTHON = ({ about, constants, variables, start, predict, correct, gated }) => `# ${about}
${constants.replaceAll(", ", "\n")}
${variables.replace("NAN", 'float("nan")').replaceAll(", ", "\n")}

def kalman(z):
    global ${variables.replace(/ = [^,]+/g, "")}
    ${predict.join("\n    ")}
    if z != z:  # NaN: no sample
        return x
    if x != x:  # the first sample is the start
        ${start.join("\n        ")}
        return x
    ${gated ? GATE_IN_PYTHON : ""}${correct.join("\n    ")}
    return x
`;

const YAML = ({ about, process, error }) => `# ${about}
sensor:
  - platform: combination
    type: kalman
    name: filtered
    process_std_dev: ${process}
    sources:
      - source: raw  # id of your raw sensor
        error: ${error}
`;

const withType = (type) => (parts) => C({ ...parts, type });
const LANGUAGES = { Arduino: withType("float"), C: withType("double"), Python: PYTHON, ESPHome: YAML };

/** The filter as text; `about` is its first line, without line ends. */
function codeOf(language, params, about, period) {
  const { q, r, p0, x0, gate, momentum } = params;
  if (language === "ESPHome") {
    if (momentum > 0) return "# ESPHome's Kalman filter has no momentum: set momentum to 0.\n";
    if (!period) return "# ESPHome counts the process noise per second: the sample period must be known.\n";
    return YAML({ about, process: Math.sqrt(q / period), error: Math.sqrt(r) });
  }
  const float = (value) => `${String(Number(value.toPrecision(9))).replace(/^(-?\d+)$/, "$1.0")}f`;
  const literal = language === "Arduino" ? float : String;
  const text = (value) => (Number.isNaN(value) ? "NAN" : literal(value));
  const assigned = (values) => Object.entries(values).map(([name, value]) => `${name} = ${text(value)}`);
  const first = filterOf({ ...params, x0: null }); // its state after the first sample
  first.update(0);
  const knowsStart = p0 != null && x0 != null;
  let constants = { q, r };
  let variables = knowsStart ? { x: x0, p: p0 } : { x: NaN, p: 0 };
  let start = { p: first.p };
  let predict = ["p += q"];
  let correct = ["k = p / (p + r)", "x += k * (z - x)", "p = k * r"];
  if (momentum > 0) {
    const { e, f, q11, q12, q22, w0 } = stepConstants(q, momentum);
    constants = { e, f, q11, q12, q22, r };
    variables = { ...variables, v: 0, g: 0, w: w0 };
    start = { p: first.p, g: first.g, w: first.w };
    predict = ["x += f * v", "v *= e", "p += f * (2 * g + f * w) + q11"];
    predict.push("g = e * (g + f * w) + q12", "w = e * e * w + q22");
    correct = [correct[0], "l = g / (p + r)", "v += l * (z - x)", correct[1], "w -= l * g", "g = l * r", correct[2]];
  }
  if (gate != null) [constants.gate, variables.refused] = [gate, 0];
  return LANGUAGES[language]({
    about, predict, correct, gated: gate != null, start: ["x = z", ...assigned(start)],
    constants: assigned(constants).join(", "), variables: assigned(variables).join(", "),
  });
}
