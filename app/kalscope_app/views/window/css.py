"""A few rules of style that viser leaves to the browser: legible tables, and space between paragraphs.

`page_script.py` applies them, so that the first picture already has them.
"""

from __future__ import annotations

from typing import Literal

HEADING = '<span class="kalscope-heading"></span>'
"""Starts a markdown paragraph that is two lines high at least, so that the charts below it do not move."""

HEADER = '<span class="kalscope-header"></span>'
"""Precedes the header, which stays visible while the tab below it scrolls."""

VERDICT = '<span class="kalscope-verdict"></span>'
"""Precedes the button that shows the verdict."""

ONE_BUTTON = '<span class="kalscope-one-button"></span>'
"""Precedes a row of one button, which is then as wide as its label."""

COMMAND = '<span class="kalscope-command"></span>'
"""Starts a markdown paragraph whose pieces of code are the words of one command."""

PRIMARY: Literal["blue"] = "blue"
"""Colour of the one filled button of a tab, shown as the theme's own; buttons without a colour are outlined."""

RULES = """
:root[data-mantine-color-scheme="light"] {
  --mantine-color-dimmed: #5f6973; --mantine-primary-color-contrast: #fff;
  --mantine-color-custom-filled: #0072b2; --mantine-color-custom-filled-hover: #005f96;
  --mantine-color-custom-outline: #0072b2; }
:root[data-mantine-color-scheme="dark"] {
  --mantine-color-dimmed: #a3a3a3; --mantine-primary-color-contrast: #000;
  --mantine-color-custom-filled: #56b4e9; --mantine-color-custom-filled-hover: #7cc5ee;
  --mantine-color-custom-outline: #56b4e9; }
:root { --mantine-color-placeholder: var(--mantine-color-dimmed); }
.mantine-Slider-thumb, .multi-slider-thumb { background: var(--mantine-primary-color-filled) !important; }
.mantine-Slider-markLabel { color: var(--mantine-color-dimmed); }
p:has(> .kalscope-heading) { min-height: 2.6em; line-height: 1.3; }
table { border-collapse: collapse; }
th, td { text-align: left; vertical-align: top; padding: 0 0.55em 0 0; }
th:last-child, td:last-child { padding-right: 0; }
p > code { overflow-wrap: anywhere; }
p:has(> .kalscope-command) > code { display: inline-block; max-width: 100%; padding: 0; }
th:not(:empty) { padding-bottom: 0.15em; }
:is(p, table, ul) + :is(p, table, ul) { margin-top: 0.45em !important; }
@media (max-width: 36em) { table { display: block; overflow-x: auto; font-size: 0.9em; } }
.mantine-Button-root[data-block]:not([style*="--button-bg"], [data-disabled]) {
  background: transparent; border: 1px solid var(--mantine-primary-color-filled); color: var(--mantine-color-text);
}
.mantine-Button-root[data-block]:not([style*="--button-bg"], [data-disabled]):hover {
  background: var(--mantine-primary-color-light);
}
.mantine-Button-root[style*="mantine-color-blue-filled"] {
  --button-bg: var(--mantine-primary-color-filled) !important;
  --button-color: var(--mantine-primary-color-contrast) !important;
}
.kalscope-stopped { position: fixed; inset: 0 0 auto; z-index: 10000; padding: 0.6em 1em; text-align: center;
  font: 600 1rem/1.4 var(--mantine-font-family); color: #fff; background: #a61b1b; }
.mantine-Slider-root + .mantine-NumberInput-root { display: none; }
.mantine-Slider-root:has(+ .mantine-NumberInput-root) { margin-bottom: 0.7em; }
@media (min-width: 36.01em) { [data-dock-region="left"] div:has(> p > label) { width: 9.3em !important; } }
.mantine-ScrollArea-scrollbar[data-orientation="vertical"] { width: 6px; }
.mantine-Slider-markWrapper { width: 0; }
.mantine-Slider-markLabel { width: max-content; }
.uplot:has(> .u-wrap[style*="width: 0px"]) { width: 100%; visibility: hidden; }
div:has(> .kalscope-header) + div { padding-bottom: 3px !important; }
div:has(> .kalscope-verdict) + div button {
  height: 28px; color: var(--button-bg); background: color-mix(in srgb, var(--button-bg) 12%, transparent);
  border: 1px solid color-mix(in srgb, var(--button-bg) 45%, transparent); }
[data-mantine-color-scheme="dark"] div:has(> .kalscope-verdict) + div button {
  color: color-mix(in srgb, var(--button-bg) 45%, white); }
div:has(> div > .kalscope-header) { display: grid; grid-template-columns: 1fr auto; }
div:has(> div > .kalscope-header) > div { grid-column: 1 / -1; }
div:has(> div > .kalscope-header) > div:has(> .kalscope-verdict) + div { grid-column: 1; }
div:has(> div > .kalscope-header) > div:has(> .kalscope-verdict) + div + div { grid-column: 2; }
div:has(> .kalscope-verdict) + div + div button { height: 28px; }
div:has(> .kalscope-one-button) + div button { flex: 0 0 auto !important; padding: 0 1em; }
@media (max-width: 1099.98px) { div:has(> .kalscope-verdict) + div + div { display: none; } }
@media (min-width: 1100px) { div:has(> .kalscope-verdict) + div { margin-right: 0 !important; } }
@media (min-width: 36.01em) {
  .mantine-ScrollArea-viewport:has(.kalscope-header) div:has(div .kalscope-header) { height: 100%; }
  div:has(> div > .kalscope-header) { box-sizing: border-box; grid-template-rows: repeat(19, auto) minmax(0, 1fr); }
  div:has(> [data-dock-area]) { grid-row: 20; min-height: 0; }
  [data-dock-area], [data-dock-area] div:has(.mantine-ScrollArea-root) { height: 100%; min-height: 0 !important; }
}
"""
"""Small texts, buttons and sliders of viser lack the contrast of WCAG 2.2 AA: 4.5 : 1 for texts, else 3 : 1.
Its markdown has no padding in its tables, centres their heads, sets paragraphs without any space, and lets a long
path run out of its panel. Beside a slider it repeats the position as a number, where the box above has the value,
its marks reach past the panel, and its column of labels is too narrow for "measurement noise r". On a phone a wide
table would make its whole panel scroll sideways.

A chart does not know its width when it is made: it is hidden until it does, and as high as it will be.

The last rules keep the header visible: every box around it, and around the tab below it, is as high as its panel
allows, so that only the tab scrolls. The verdict is a word in its colour, not a filled button."""
