"""The form with the import options, named as on the command line."""

from __future__ import annotations

import re
from collections.abc import Callable

import viser

from kalscope.sources.grammar.read_options import (
    OPTIONS,
    ReadOptions,
    join_values,
    option_texts,
    options_from_text,
    split_values,
)
from kalscope_app.views.binding import on_user


class ReadingForm:
    """Options in place of what was detected; empty boxes are detected. The rarer ones are one click away."""

    def __init__(self, gui: viser.GuiApi, read: Callable[[ReadOptions], None]) -> None:
        self._gui, self._read = gui, read
        self._shown: ReadOptions | None = None
        self._boxes: dict[str, viser.GuiInputHandle[str]] = {}
        self._add_choice("delimiter", MARKS, "The character between two cells.")
        self._add_text("time_column", "Its name, its number from 1, or none.")
        self._add_choice("time_unit", UNITS, "The unit of a numeric time column.")
        self._add_text("missing", 'Values that mark a missing sample, between blanks: -200 n/x "no data".')
        self._add_choice("gaps", GAPS, "How long gaps are filtered.")
        with gui.add_folder("More options", expand_by_default=False):
            self._add_text("header_row", "Number of the line with the names; 0 = none.")
            self._add_text("unit_row", "Number of the line with the units; 0 = none.")
            self._add_choice("decimal", POINTS, "The decimal mark of numbers.")
            self._add_text("time_format", "Format of a time stamp, such as %d.%m.%Y %H:%M:%S.")
            self._add_choice("day_first", ORDERS, "What 03/04/2025 is: 3 April, or March 4.")
            self._add_text("rate", "The sample rate, instead of that of the stamps.")
            self._add_text("part", "The sheet, topic, group or variable of a file that holds several.")
            self._add_text("unpack_gb", "What a packed file may unpack to; empty: 0.134 GB, or 32 times its size.")
        button = gui.add_button("Re-import", hint="Also reads what was added to the file.")
        on_user(button.on_click, lambda _client: self._submit())

    def _add_text(self, option: str, hint: str) -> None:
        self._boxes[option] = self._gui.add_text(_label(option), "", hint=hint)

    def _add_choice(self, option: str, choices: dict[str, str], hint: str) -> None:
        self._boxes[option] = self._gui.add_dropdown(_label(option), tuple(choices), hint=hint)

    def show(self, options: ReadOptions) -> None:
        """Fill in what the open file was read with; what is typed stays until another is."""
        if options is self._shown:
            return
        self._shown, texts = options, option_texts(options)
        for option, box in self._boxes.items():
            values = texts.get(option, ())
            text = join_values(values) if option == "missing" else "".join(values)
            words = {meaning: word for word, meaning in CHOICES.get(option, {}).items()}
            box.value = words.get(text, text)

    def _submit(self) -> None:
        typed = {option: box.value.strip() for option, box in self._boxes.items()}
        given = {option: CHOICES.get(option, {}).get(text, text) or None for option, text in typed.items()}
        order, missing = given.pop("day_first"), given.pop("missing")
        self._read(
            options_from_text(
                missing=split_values(missing or ""),
                day_first=None if order is None else order == "day",
                **given,
            )
        )


FOUND = "auto"
"""Detect it from the file."""

MARKS = {FOUND: "", **{word: word for word in ("comma", "semicolon", "tab", "bar", "space")}}
UNITS = {FOUND: "", **{word: word for word in ("s", "ms", "us", "ns", "min", "h", "day", "year")}}
POINTS = {FOUND: "", "point": "point", "comma": "comma"}
ORDERS = {FOUND: "", "day first": "day", "month first": "month"}
GAPS = {"as rows": "", "as missing samples": "missing", "as elapsed time": "dt"}
"""How long gaps in time are filtered."""
CHOICES = {"delimiter": MARKS, "time_unit": UNITS, "decimal": POINTS, "day_first": ORDERS, "gaps": GAPS}
"""What a menu shows and what the command line takes, by the name of the option."""

LABELS = {
    "missing": "missing values",
    "gaps": "gaps in time",
    "decimal": "decimal mark",
    "day_first": "date order",
    "rate": "rate (Hz)",
    "unpack_gb": "unpack at most (GB)",
}
"""Labels of the boxes whose label is not the name of the option."""
_MENTIONED = re.compile(
    r"--([a-z]{2,9}(?:-[a-z]{2,9})?)"
    r"""(?:[ =](NAME|"[^"]{1,200}"|-?[0-9][0-9.e+-]{0,30}|[a-z]{2,9})(?![\w.]))?"""
)


def in_words_of_form(sentence: str) -> str:
    """A sentence about options of the command line in the words of this form: `--gaps dt` is its box for gaps."""
    return _MENTIONED.sub(_box_and_value, sentence)


def _box_and_value(mention: re.Match[str]) -> str:
    option, value = mention[1].replace("-", "_"), mention[2] or ""
    if f"--{mention[1]}" not in OPTIONS:
        return mention[0]
    if option in ("day_first", "month_first"):
        option, value, rest = "day_first", option.replace("_", " "), f" {value}" if value else ""
        return f"“{_label(option)}”: {value}{rest}"
    words = {meaning: word for word, meaning in CHOICES.get(option, {}).items() if meaning}
    if value in words or (value and not value.isalpha()) or value == "none":
        return f"“{_label(option)}”: {words.get(value, value)}"
    return f"“{_label(option)}”" + (f" {value}" if value not in ("", "NAME") else "")


def _label(option: str) -> str:
    return LABELS.get(option) or option.replace("_", " ")
