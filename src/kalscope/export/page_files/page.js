// The page: what is opened, the sliders, the chart and the code.

const $ = (id) => document.getElementById(id);
const digits = (value, n = 4) => String(Number(value.toPrecision(n)));
const KEEPS_ALL = "The best fit removes nothing here: what looks like noise may be movement.";
const STEPS = 120; // of a slider on either side of its middle, 20 a decade
const AUTOMATIC = STEPS + 1; // the right end of the slider of p0
const PARAMETERS = {
  q: { label: "process noise q", hint: "variance per sample" },
  r: { label: "measurement noise r", hint: "variance" },
  p0: { label: "initial variance p0", hint: "empty: automatic", top: AUTOMATIC },
  momentum: { label: "momentum (samples)", hint: "0: none", bottom: -41, middle: 100 },
};
const given = JSON.parse($("data").textContent);
let opened = given; // what is opened: title, period, time, channels
let [at, chart, drawn] = [0, null, []]; // the channel, its chart, and what that shows

const channel = () => opened.channels[at];
const params = () => channel().params;
const lagUnit = () => (opened.period ? { unit: "ms", scale: 1000 * opened.period } : { unit: "samples", scale: 1 });
const say = (text) => { $("message").textContent = text; };

/** The numbers of packed samples: whole multiples of 10^-digits as differences, or doubles. */
async function unpacked({ kind, digits: decimals, data }) {
  const bytes = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  if (kind === "doubles") return new Float64Array(buffer);
  let sum = 0;
  const isMissing = (step) => step === -(2 ** 31);
  return Float64Array.from(new Int32Array(buffer), (step) => (isMissing(step) ? NaN : (sum += step) / 10 ** decimals));
}

// Drawing.

const drawable = (values) => Array.from(values, (value) => (Math.abs(value) < 1e150 ? value : null));

function draw(isNew = false) {
  drawn = [drawn[0], drawn[1], drawable(filtered(channel().z, params()))];
  chart.setData(drawn, isNew);
  if (!isNew) chart.redraw(true, true);
  const { lag, noise } = settled(params());
  const decibels = noise > 0 ? ` (${digits(20 * Math.log10(noise), 3)} dB)`.replace("-", "−") : "";
  $("lag").textContent = lagText(lag);
  $("noise").textContent = `leaves ${digits(100 * noise, 3)} %${decibels}`;
  for (const [name, row] of Object.entries(PARAMETERS)) showParameter(name, row);
  showCode();
}

function lagText(samples) {
  if (!Number.isFinite(samples)) return "without end";
  if (!opened.period) return `${digits(samples)} samples`;
  const seconds = samples * opened.period;
  const units = [[86400, "days"], [3600, "h"], [60, "min"], [1, "s"], [1e-3, "ms"], [1e-6, "µs"]];
  const [scale, unit] = units.find(([size]) => seconds >= size) ?? [1e-6, "µs"];
  return `${digits(seconds / scale)} ${unit}`;
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);

function makeChart() {
  chart?.destroy();
  const { z, name, unit } = channel();
  drawn = [Array.from(z, (_, i) => opened.time?.[i] ?? i * (opened.period ?? 1)), drawable(z), []];
  const grid = { stroke: () => colour("--edge"), width: 1 };
  const axis = (label) => ({ label, stroke: () => colour("--ink"), grid });
  const line = (label, style, width) => ({ label, stroke: () => colour(style), width, points: { show: false } });
  chart = new uPlot({
    width: $("chart").clientWidth, height: Math.max(220, Math.min(420, 0.5 * innerHeight)),
    scales: { x: { time: false } },
    series: [{}, line("raw", "--raw", 1), line("filtered", "--filtered", 2)],
    axes: [axis(opened.period ? "time (s)" : "sample"), axis(unit ? `${name} (${unit})` : name)],
    legend: { live: false },
  }, [drawn[0], drawn[1], drawn[1]], $("chart"));
}

// Parameters.

let frame = 0;
function change(changes) {
  Object.assign(params(), changes);
  cancelAnimationFrame(frame);
  frame = requestAnimationFrame(() => draw());
}

/** The value in the middle of a slider: the one that the page was opened with. */
const middleOf = (name) => PARAMETERS[name].middle ?? (channel().start[name] || channel().start.r || 1);

function makeParameter(name, { label, hint, top = STEPS, bottom = -STEPS }) {
  const row = document.createElement("div");
  row.innerHTML = '<label></label><input type="range"><input inputmode="decimal" autocomplete="off">';
  const [text, slider, box] = row.children;
  Object.assign(text, { textContent: label, htmlFor: `${name}-box`, title: hint });
  Object.assign(slider, { id: `${name}-slider`, ariaLabel: label, min: bottom, max: top });
  Object.assign(box, { id: `${name}-box`, title: hint });
  slider.addEventListener("input", () => {
    const end = Number(slider.value) === (name === "p0" ? AUTOMATIC : bottom);
    const value = middleOf(name) * 10 ** (slider.value / 20);
    change({ [name]: name === "p0" && end ? null : name === "momentum" && end ? 0 : value });
  });
  box.addEventListener("change", () => {
    const typed = box.value.replace(/[\s\u202f]/g, "");
    const isAutomatic = name === "p0" && (typed === "" || typed === "automatic");
    const least = name === "r" ? 1e-100 : 0;
    const isGood = isAutomatic || (typed !== "" && Number(typed) >= least && Number(typed) < 1e100);
    say(isGood ? "" : `${label} must be a number ${name === "r" ? "above 0" : "of at least 0"} (got ${box.value})`);
    change(isGood ? { [name]: isAutomatic ? null : Number(typed) } : {});
  });
  $("parameters").append(row);
}

function showParameter(name, { top = STEPS, bottom = -STEPS }) {
  const [value, slider, box] = [params()[name], $(`${name}-slider`), $(`${name}-box`)];
  const position = value === null ? top : value === 0 ? bottom : 20 * Math.log10(value / middleOf(name));
  if (document.activeElement !== slider) slider.value = Math.round(position);
  if (document.activeElement !== box) box.value = value === null ? "automatic" : digits(value);
  slider.ariaValueText = box.value;
}

// Code.

let language = "Arduino";
function showCode() {
  const [{ q, r }, { lag }, { name, unit }] = [params(), settled(params()), channel()];
  const variance = (value) => `${digits(value)}${unit ? ` ${unit}²` : ""}`;
  const words = `Kalman filter of ${name}: q = ${variance(q)}, r = ${variance(r)}, lag ${lagText(lag)}`;
  const about = words.replace(/[^\x20-\x7e²µ°]|\\/g, "?");
  $("text").textContent = codeOf(language, params(), about, opened.period);
}

for (const name of Object.keys(LANGUAGES)) {
  const button = Object.assign(document.createElement("button"), { textContent: `Copy ${name}` });
  button.addEventListener("click", async () => {
    language = name;
    showCode();
    getSelection().selectAllChildren($("text")); // to copy by hand where a browser keeps the clipboard from the page
    await navigator.clipboard.writeText($("text").textContent);
    say(`Copied: ${name}.`);
  });
  $("languages").append(button, " ");
}

// Opening.

function pick(index) {
  at = index;
  const one = channel();
  if (!one.start) {
    const fit = bestFit(one.z);
    if (!fit) say(`${KEEPS_ALL} A lag of 5 samples is shown.`);
    one.start = { ...(fit ?? harmless(one.z)), p0: null, x0: null, gate: null, momentum: 0 };
  }
  one.params ??= { ...one.start };
  if (!one.z.some(Number.isFinite)) say(`${one.name} has no samples.`);
  makeChart();
  const { lag } = settled(params());
  $("max-lag-label").textContent = `maximum lag (${lagUnit().unit})`;
  $("max-lag").value = digits(Number.isFinite(lag) ? lag * lagUnit().scale : 10);
  draw(true);
}

function show(recording) {
  opened = recording;
  $("channel").replaceChildren(...recording.channels.map(({ name }, i) => new Option(name, i)));
  $("channels").hidden = recording.channels.length < 2;
  $("tune").hidden = false;
  pick(recording.selected ?? 0);
}

const openTable = (text) => { try { say(""); show(readTable(text)); } catch (error) { say(error.message); } };

for (const [name, row] of Object.entries(PARAMETERS)) makeParameter(name, row);
$("channel").addEventListener("change", () => pick(Number($("channel").value)));
$("goal").addEventListener("submit", (event) => {
  event.preventDefault();
  const lag = Number($("max-lag").value) / lagUnit().scale;
  const isGood = lag > 1e-6 && lag < 1e9;
  say(isGood ? "" : `The maximum lag must be above 0 ${lagUnit().unit} (got ${$("max-lag").value})`);
  if (isGood) change({ q: qForLag(lag, params()) });
});
$("fit").addEventListener("click", () => {
  const fit = bestFit(channel().z);
  say(fit ? "" : `${KEEPS_ALL} Choose a lag instead.`);
  if (fit) change({ ...fit, momentum: 0 });
});
$("reset").addEventListener("click", () => change({ ...channel().start }));
new ResizeObserver(() => chart?.setSize({ width: $("chart").clientWidth, height: chart.height })).observe($("chart"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => chart?.redraw());

globalThis.kalscope = { opened: () => opened, channel, params, filtered, settled, bestFit, codeOf, readTable };

if (given.channels) {
  const channels = await Promise.all(given.channels.map(async (one) => ({ ...one, z: await unpacked(one.z) })));
  show({ ...given, channels, time: given.time && (await unpacked(given.time)) });
} else {
  $("open").hidden = false;
  $("reads").textContent = `Reads ${READS}.`;
  $("file").addEventListener("change", async () => openTable(await $("file").files[0].text()));
  $("read").addEventListener("click", () => openTable($("paste").value));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", async (event) => {
    event.preventDefault();
    openTable((await event.dataTransfer.files[0]?.text()) ?? event.dataTransfer.getData("text"));
  });
}
