// Makes what viser leaves to the mouse work by keys and for screen readers: the headings of folders are buttons, and
// the thumbs of sliders bear the names of their rows; see page_script.py.

const HEADING = '.mantine-Paper-root[data-with-border] > .mantine-Paper-root[style*="pointer"]:has(> svg)';

const label = () => {
  for (const heading of document.querySelectorAll(HEADING)) {
    heading.tabIndex = 0;
    heading.role = "button";
    heading.ariaExpanded = String(!!heading.querySelector(".tabler-icon-chevron-up"));
  }
  for (const row of document.querySelectorAll("label[for]")) {
    const thumbs = document.getElementById(row.htmlFor)?.querySelectorAll("[role=slider]") ?? [];
    for (const thumb of thumbs) if (thumb.ariaLabel !== row.textContent) thumb.ariaLabel = row.textContent;
  }
};

addEventListener("keydown", (event) => {
  if ((event.key === "Enter" || event.key === " ") && event.target.matches?.(HEADING)) {
    event.preventDefault();
    event.target.click();
  }
});

// viser turns the camera of its scene by the arrow keys, also while a slider or a tab has the focus: a dozen frames for
// each press. It listens on the document; React has had the key by then.
addEventListener("DOMContentLoaded", () =>
  document.body.addEventListener("keydown", (event) => {
    if (event.key.startsWith("Arrow") && event.target.matches("[role=slider], [role=tab]")) event.stopPropagation();
  }),
);

let waiting = 0;
const onChange = () => (waiting ||= setTimeout(() => ((waiting = 0), label()), 200));
addEventListener("DOMContentLoaded", () =>
  new MutationObserver(onChange).observe(document.body, { childList: true, subtree: true }),
);
