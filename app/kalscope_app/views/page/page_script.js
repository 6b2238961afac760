// Fits viser's messages to this window, and writes the numbers under the mouse; see window.py, which defines
// `sizes` before this text.

const mapFrom = 1100; // px; a narrower window has no map
const mapShare = 0.38; // of the width beside the control panel, at most
const mapShape = 0.5; // width : height at most
const phone = matchMedia(sizes.phoneWidth);
const charts = new Map(); // uuid -> height and share of the window, as sent by the server
const phoneCheckboxes = new Set();
const windows = new WeakSet(); // the parts of charts that show the window of the recording
let zoom = ""; // the hidden widget that asks for another window
let lag = ""; // the hidden widget that takes a lag
let rightPanel = null; // the last message with its width
let deliver = () => {};
let send = () => {};

const rightWidth = () => {
  const free = innerWidth - sizes.left;
  const map = Math.round(Math.min(mapShape * innerHeight, Math.max(sizes.minMap, mapShare * free)));
  const shown = rightPanel.width === sizes.withMap && innerWidth >= mapFrom;
  document.documentElement.classList.toggle("kalscope-no-map", !shown);
  return Math.max(300, free - (shown ? map : sizes.noMap));
};

const chartHeight = ({ height, share }) =>
  Math.max(80, Math.round(height + share * (Math.max(innerHeight, sizes.minHeight) - sizes.height)));

const written = (_chart, value) => {
  if (!Number.isFinite(value)) return "";
  const size = Math.abs(value);
  const short = size !== 0 && (size < 1e-3 || size >= 1e7) ? value.toExponential(3) : String(+value.toPrecision(6));
  return short.replace("e+", "e").replace("-", "−");
};

// As the texts beside the charts: thin spaces between thousands, a minus sign; and no tick of 1e-6 is written as 0.
const ticks = (_chart, at, _axis, _space, step) =>
  at.map((value) => {
    const exact = +(Math.round((value / step) * 1000) * (step / 1000)).toPrecision(12);
    const size = Math.abs(exact);
    if (size !== 0 && (size < 1e-4 || size >= 1e7)) return written(null, exact);
    const [whole, ...part] = String(exact).replace("-", "−").split(".");
    return [whole.replace(/\B(?=(\d{3})+$)/g, "\u202f"), ...part].join(".");
  });

const notInGaps = (chart, line, index) => (Number.isNaN(chart.data[line][index]) ? null : index);

// A drag over a chart of the recording zooms in at once, and then asks the server for that window.
const dragged = (chart, target, handle, onlyTarget = true) => {
  windows.add(chart.over);
  return (event) => {
    if (event.button !== 0 || (onlyTarget && event.target !== target)) return;
    const { left, width } = chart.select;
    const all = chart.over.clientWidth;
    handle(event);
    if (width > 0) askForWindow([left / all, (left + width) / all]);
  };
};

const clicked = (chart, _target, handle) => (event) => {
  handle(event);
  if (event.button === 0) put(lag, chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x"));
};

const put = (uuid, value) =>
  uuid && send({ type: "send", message: { type: "GuiUpdateMessage", uuid, updates: { value } } });

const askForWindow = (value) => put(zoom, value);

const tellPhone = (uuid) => put(uuid, phone.matches);

const fit = (message) => {
  const { type, uuid, props, updates } = message;
  (props ?? updates)?.series?.forEach?.((series) => (series.value = written));
  (props ?? updates)?.axes?.forEach?.((axis) => (axis.values ??= ticks));
  const cursor = (props ?? updates)?.cursor;
  if (cursor) cursor.dataIdx = notInGaps;
  if (cursor?.window) cursor.bind = { mouseup: dragged };
  if (cursor?.chooses) cursor.bind = { mouseup: clicked };
  if (type === "GuiMultiSliderMessage" && props.label === sizes.zoom) zoom = uuid;
  if (type === "GuiNumberMessage" && props.label === sizes.lag) lag = uuid;
  if (type === "GuiSetPanelWidthMessage" && [sizes.withMap, sizes.withoutMap].includes(message.width)) {
    rightPanel = { ...message };
    message.width = rightWidth();
  } else if (type === "GuiUplotMessage" && cursor?.share) {
    charts.set(uuid, { height: props.height, share: cursor.share });
    props.height = chartHeight(charts.get(uuid));
  } else if (type === "GuiUpdateMessage" && charts.has(uuid) && updates.height) {
    Object.assign(charts.get(uuid), { height: updates.height, share: cursor?.share ?? charts.get(uuid).share });
    updates.height = chartHeight(charts.get(uuid));
  } else if (type === "GuiCheckboxMessage" && props.label === sizes.phone) {
    phoneCheckboxes.add(uuid);
    tellPhone(uuid);
  }
};

const fitAgain = () => {
  if (!rightPanel) return;
  rightPanel.counter += 1e-6; // viser takes only messages newer than the last, and the server counts in ones
  const heights = [...charts].map(([uuid, chart]) => ({
    type: "GuiUpdateMessage",
    uuid,
    updates: { height: chartHeight(chart) },
  }));
  deliver({ data: { type: "message_batch", messages: [{ ...rightPanel, width: rightWidth() }, ...heights] } });
};

window.Worker = class extends Worker {
  set onmessage(handler) {
    super.onmessage = (event) => {
      if (event.data?.type === "connected") {
        charts.clear();
        phoneCheckboxes.clear();
        deliver = handler;
        send = (message) => this.postMessage(message);
      } else if (event.data?.type === "message_batch") {
        event.data.messages.forEach(fit);
      }
      handler(event);
    };
  }
};

const leadToTab = ({ target }) => {
  const text = target.closest("button")?.textContent ?? "";
  const name = text.startsWith(sizes.goal) ? "Tune" : sizes.leads[text]; // a command has its description, too
  const tab = name && [...document.querySelectorAll("[role=tab]")].find((tab) => tab.textContent === name);
  tab?.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true })); // tabs do not listen for clicks
};

// Copies the text box above a button: the clipboard's own interface is for pages of https alone.
const copyText = ({ target }) => {
  if (target.closest("button")?.textContent !== sizes.copyButton) return;
  const above = (text) => text.compareDocumentPosition(target) & Node.DOCUMENT_POSITION_FOLLOWING;
  const texts = [...document.querySelectorAll("textarea:not([aria-hidden])")];
  texts.findLast((text) => text.checkVisibility() && above(text))?.select();
  document.execCommand("copy");
};

addEventListener("resize", fitAgain);
addEventListener("click", leadToTab);
addEventListener("click", copyText);
addEventListener("dblclick", ({ target }) => windows.has(target) && askForWindow([-1, 2]), true);
phone.addEventListener("change", () => phoneCheckboxes.forEach(tellPhone));
