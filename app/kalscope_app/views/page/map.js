// Shows the tuning map between the panels and reports where in it the user points; see window.py, which defines
// `sizes` before this text.
//
// The picture is a plain image: in viser's scene the map would be drawn again for each move of its mark, which takes
// 100 to 600 ms without a graphics card and holds up the charts. Without the map the chart panel covers the strip that
// viser keeps between its panels, from the first picture on: so these rules do not wait for the server.

const rules = document.head.appendChild(document.createElement("style"));
rules.textContent = `
.kalscope-map { display: none; position: absolute; inset: 0; place-items: center; overflow: hidden;
  container-type: size; --paper: #eceff2; --mark: #D55E00; background: var(--paper); cursor: pointer;
  touch-action: none; user-select: none; }
[data-mantine-color-scheme="dark"] .kalscope-map { --paper: #1e2024; --mark: #ff8a3d; }
.kalscope-map > div { position: relative; aspect-ratio: var(--shape); width: min(100cqw, 100cqh * var(--shape));
  transform-origin: 0 0; }
.kalscope-map img { position: absolute; left: 0; top: 0; width: 100%; pointer-events: none; }
.kalscope-mark { position: absolute; width: 7.5%; aspect-ratio: 1; translate: -50% -50%; pointer-events: none;
  background: radial-gradient(closest-side, var(--mark) 10%, var(--paper) 12% 14%, transparent 16% 40%,
    var(--paper) 42% 49%, var(--mark) 51% 71%, var(--paper) 73% 79%, transparent 81%); }
.kalscope-no-map [data-dock-region="right"] { box-sizing: content-box; padding-left: 116px; }
.kalscope-no-map [data-dock-region="right"] > div:not([data-dock-region-resize]) { margin-left: -116px; }
.kalscope-no-map [data-dock-region="right"] > div > div:has([data-dock-column]) { width: 100% !important; }
@media not all and ${sizes.phoneWidth} {
  .kalscope-map { display: grid; }
  .kalscope-no-map .kalscope-map > div { display: none; }
}`;

const mapGrip = 0.04; // of the picture's width: nearer to the mark a drag grabs it; from farther away the mark jumps
const map = document.createElement("div");
const sheet = map.appendChild(document.createElement("div"));
const picture = sheet.appendChild(new Image());
const mark = sheet.appendChild(document.createElement("div"));
map.className = "kalscope-map";
picture.alt = "Map of q and r: which pairs suit the recording";
Object.assign(mark, { className: "kalscope-mark", role: "img", ariaLabel: "Where q and r are now" });
sheet.style.visibility = mark.style.visibility = "hidden";

const widgets = new Map(); // uuid -> kind of message and label of a hidden widget of the map
const view = { scale: 1, x: 0, y: 0 }; // zoom of the sheet, and how far it is moved, px
let present = [-1, -1]; // where the mark is, in shares of the picture
let gesture = Math.floor(1e6 * Math.random()); // counts gestures; other pages count from another number
let held = null; // the gesture while a button is down
let waiting = 0;
let send = () => {};

const load = (data) => {
  if (!data) return;
  URL.revokeObjectURL(picture.src);
  picture.src = URL.createObjectURL(new Blob([data]));
};

picture.addEventListener("load", () => {
  sheet.style.setProperty("--shape", picture.naturalWidth / picture.naturalHeight);
  sheet.style.visibility = picture.naturalWidth > 2 ? "inherit" : "hidden"; // a dot means: no picture yet
});

const moveMark = ([x, y]) => {
  present = [x, y];
  Object.assign(mark.style, { left: `${100 * x}%`, top: `${100 * y}%`, visibility: x < 0 ? "hidden" : "inherit" });
};

const take = ({ type, uuid, value, props, updates }) => {
  if (props?.label) widgets.set(uuid, `${type} ${props.label}`);
  const { value: newest, _data } = updates ?? { value, ...props };
  const widget = widgets.get(uuid);
  if (widget === `GuiImageMessage ${sizes.mapPicture}`) load(_data);
  else if (widget === `GuiVector2Message ${sizes.mapPresent}` && newest) moveMark(newest);
};

const pointed = () => [...widgets].find(([, widget]) => widget === `GuiVector3Message ${sizes.mapPointed}`)?.[0];

// A third number below 0 is that of a click.
const tell = ([x, y], number) => {
  const uuid = pointed();
  if (uuid) send({ type: "GuiUpdateMessage", uuid, updates: { value: [x, y, number] } });
};

const place = ({ clientX, clientY }) => {
  const { left, top, width, height } = sheet.getBoundingClientRect();
  return [(clientX - left) / width, (clientY - top) / height];
};

// The offset from the start of a drag to the mark, if the drag grabs the mark; else 0: the mark jumps to the pointer.
const grip = ([x, y]) => {
  const { offsetWidth, offsetHeight } = sheet;
  const away = [present[0] - x, present[1] - y];
  return Math.hypot(away[0] * offsetWidth, away[1] * offsetHeight) <= mapGrip * offsetWidth ? away : [0, 0];
};

const drag = () => {
  waiting = 0;
  if (held?.to) tell([held.to[0] + held.offset[0], held.to[1] + held.offset[1]], held.number);
};

// The picture always fills its place, so zooming out always ends with all of it.
const look = (scale, x, y) => {
  const least = [(1 - scale) * sheet.offsetWidth, (1 - scale) * sheet.offsetHeight];
  const [left, top] = [x, y].map((shift, i) => Math.min(0, Math.max(least[i], shift)));
  Object.assign(view, { scale, x: left, y: top });
  sheet.style.transform = scale === 1 ? "" : `translate(${left}px, ${top}px) scale(${scale})`;
};

map.addEventListener("pointerdown", (event) => {
  if (held) return;
  map.setPointerCapture(event.pointerId);
  held = { button: event.button, from: event, x: view.x, y: view.y, number: ++gesture, offset: grip(place(event)) };
});

map.addEventListener("pointermove", (event) => {
  if (!held) return;
  const [across, down] = [event.clientX - held.from.clientX, event.clientY - held.from.clientY];
  held.moved ||= Math.hypot(across, down) > 3;
  if (held.button === 2) look(view.scale, held.x + across, held.y + down);
  else if (held.button === 0 && held.moved) {
    held.to = place(event);
    waiting ||= requestAnimationFrame(drag);
  }
});

map.addEventListener("pointerup", (event) => {
  if (held?.to) drag();
  else if (held?.button === 0) tell(place(event), -held.number);
  held = null;
});

map.addEventListener("pointercancel", () => (held = null));
map.addEventListener("contextmenu", (event) => event.preventDefault());

map.addEventListener(
  "wheel",
  (event) => {
    event.preventDefault();
    const { left, top } = sheet.getBoundingClientRect();
    const scale = Math.min(20, Math.max(1, view.scale * Math.exp(-event.deltaY / 500)));
    const grown = scale / view.scale - 1;
    look(scale, view.x - grown * (event.clientX - left), view.y - grown * (event.clientY - top));
  },
  { passive: false },
);

// The tab of a fleet is there only while one is open, and comes to the front when it appears.
let fleetTab = null;
new MutationObserver(() => {
  const tab = document.querySelector('[data-dock-tab][title="Fleet"]');
  if (tab && !fleetTab) tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
  fleetTab = tab;
}).observe(document, { childList: true, subtree: true });

window.Worker = class extends Worker {
  set onmessage(handler) {
    send = (message) => super.postMessage({ type: "send", message });
    super.onmessage = (event) => {
      if (event.data?.type === "connected") widgets.clear();
      else if (event.data?.type === "message_batch") event.data.messages.forEach(take);
      if (!map.isConnected) document.querySelector(sizes.scene)?.after(map);
      handler(event);
    };
  }
};
