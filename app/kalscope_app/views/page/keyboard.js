// Makes what viser leaves to the mouse work by keys and for screen readers: the headings of folders are buttons,
// every control has the name of its row and its hint, which viser shows under the mouse, and a new verdict is read
// out; see window.py.

const HEADING = '.mantine-Paper-root[data-with-border] > .mantine-Paper-root[style*="pointer"]:has(> svg)';

const FOCUSABLE = ":is(button, input, textarea, [tabindex]):not([tabindex='-1'])";

const UNNAMED = {
  ".mantine-Notification-closeButton": "Dismiss",
  ".mantine-Spotlight-content": "Commands",
  ".uplot-container > button": "Enlarge the chart",
}; // parts without a text

const hints = new Map(); // uuid -> what a control is for

const describe = (control, name, hint) => {
  if (control.ariaLabel !== name) control.ariaLabel = name;
  if (hint && control.ariaDescription !== hint) control.ariaDescription = hint;
};

const nameHeadings = () => {
  for (const heading of document.querySelectorAll(HEADING)) {
    heading.tabIndex = 0;
    heading.role = "button";
    heading.ariaExpanded = String(!!heading.querySelector(".tabler-icon-chevron-up"));
  }
};

// Only some of viser's controls have the id that their label refers to.
const nameControls = () => {
  for (const row of document.querySelectorAll("p > label[for]")) {
    const beside = row.closest("p").parentElement.nextElementSibling;
    for (const control of beside?.querySelectorAll("input:not([type=hidden]), textarea, [role=slider]") ?? [])
      describe(control, row.textContent, hints.get(row.htmlFor));
  }
};

const nameTheRest = () => {
  for (const [parts, name] of Object.entries(UNNAMED))
    for (const part of document.querySelectorAll(parts)) describe(part, name);
  for (const chart of document.querySelectorAll(".uplot")) {
    const plot = chart.querySelector(".u-wrap"); // what is drawn; the legend beside it can be read
    plot.role = "img";
    describe(plot, `Chart of ${[...chart.querySelectorAll(".u-legend .u-label")].map((one) => one.textContent).join(", ")}`);
  }
  for (const thumb of document.querySelectorAll(".multi-slider-thumb")) {
    Object.assign(thumb, { tabIndex: 0, role: "slider", ariaValueNow: parseFloat(thumb.style.left) });
    describe(thumb, thumb.previousElementSibling?.matches(".multi-slider-thumb") ? "end of the view" : "begin of the view");
  }
  for (const view of document.querySelectorAll(".mantine-ScrollArea-viewport"))
    if (!view.querySelector(FOCUSABLE)) view.tabIndex = 0; // else no key scrolls it
  for (const cell of document.querySelectorAll("th:empty:not([role])")) cell.role = "cell"; // heads no column
  for (const title of document.querySelectorAll("h3.mantine-Title-root")) title.ariaLevel = "2"; // below the page's
  for (const title of document.querySelectorAll("[data-dock-header] div:not(:has(*))"))
    if (title.textContent === "Kalscope") Object.assign(title, { role: "heading", ariaLevel: "1" });
};

// One stop of the Tab key for each strip of tabs; the arrow keys go along it.
const joinTabs = () => {
  for (const tab of document.querySelectorAll("[role=tab]")) tab.tabIndex = tab.ariaSelected === "true" ? 0 : -1;
};

const verdict = Object.assign(document.createElement("div"), { role: "status", className: "kalscope-status" });

const announce = () => {
  const word = document.querySelector("div:has(> .kalscope-verdict) + div button")?.textContent ?? "…";
  if (!verdict.isConnected) document.getElementById("root").before(verdict);
  if (word !== "…" && verdict.textContent !== word) verdict.textContent = word;
};

const label = () => {
  nameHeadings();
  joinTabs();
  announce();
  nameControls();
  nameTheRest();
};

window.Worker = class extends Worker {
  set onmessage(handler) {
    super.onmessage = (event) => {
      for (const { uuid, props } of event.data?.messages ?? []) if (props?.hint) hints.set(uuid, props.hint);
      handler(event);
    };
  }
};

addEventListener("keydown", (event) => {
  if ((event.key === "Enter" || event.key === " ") && event.target.matches?.(HEADING)) {
    event.preventDefault();
    event.target.click();
  }
});

// viser turns the camera of its scene with the arrow keys, even while a slider or a tab has the focus: a dozen frames
// for each press. It listens on the document; React has handled the key by then.
addEventListener("DOMContentLoaded", () =>
  document.body.addEventListener("keydown", (event) => {
    if (event.key.startsWith("Arrow") && event.target.matches("[role=slider], [role=tab]")) event.stopPropagation();
  }),
);

addEventListener("DOMContentLoaded", () => (document.getElementById("root").role = "main"));

// The range control of viser listens to the mouse alone: an arrow key moves a thumb by a hundredth of the track.
const moveThumb = (event) => {
  const thumb = event.target;
  const turn = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!turn || !thumb.matches?.(".multi-slider-thumb")) return;
  const { left, width } = thumb.getBoundingClientRect();
  const clientX = left + width / 2 + (turn * thumb.parentElement.clientWidth) / 100;
  thumb.dispatchEvent(new MouseEvent("mousedown", { bubbles: true }));
  setTimeout(() => {
    for (const type of ["mousemove", "mouseup"]) document.dispatchEvent(new MouseEvent(type, { clientX }));
  }, 20); // once React has seen the press
};

addEventListener("keydown", moveThumb, true); // before the listener above ends the event

let waiting = 0;
const onChange = () => (waiting ||= setTimeout(() => ((waiting = 0), label()), 200));
addEventListener("DOMContentLoaded", () =>
  new MutationObserver(onChange).observe(document.body, {
    attributeFilter: ["aria-selected"],
    characterData: true,
    childList: true,
    subtree: true,
  }),
);
