"""New variables of Teleplot: one more column each, after the others."""

from __future__ import annotations

from dataclasses import replace

from kalscope.sources.grammar.line_format import LineFormat, Teleplot, split_teleplot
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.sniffer import MAX_STREAM_COLUMNS, Layout

_MAX_NAMES = 1024
"""Names that were seen once and are remembered; damage on the wire makes a new one of each line."""


class TeleplotVariables:
    """Which new names of one stream are accepted."""

    def __init__(self) -> None:
        self._seen_once = set[str]()

    def layout_with(self, line: str, layout: Layout | None, *, settled: bool) -> Layout | None:
        """The layout with the new variable of a line; None for a line without one.

        Args:
            line: The line.
            layout: As it is known.
            settled: Whether the head of the stream is over: a name then counts from its second line on, because one
                that came once may be damage.
        """
        plot = split_teleplot(line) if line.lstrip().startswith(">") else None
        grown = None if plot is None else with_variable(layout, plot)
        if plot is None or grown is None or not settled or plot.only_names or plot.name in self._seen_once:
            return grown
        if len(self._seen_once) >= _MAX_NAMES:
            self._seen_once.clear()
        self._seen_once.add(plot.name)
        return None


def with_variable(layout: Layout | None, plot: Teleplot) -> Layout | None:
    """The layout with a column for the variable of a line.

    Args:
        layout: As it is known; None before any line, when `>name:` alone is enough.
        plot: The line.

    Returns:
        None where no column is to be added: the lines are not of Teleplot, the variable has one, the line has no
        valid name, or there are MAX_STREAM_COLUMNS already.
    """
    if not plot.name or not plot.name.isprintable():
        return None
    column = Column(plot.name, plot.unit)
    if layout is None:
        form = LineFormat("teleplot", labels=(plot.name,))
        notes = ("each line is one variable of Teleplot",)
        return Layout(form, (column,), None, 1, frozenset(), (), notes) if plot.only_names else None
    form = layout.form
    if form.kind != "teleplot" or plot.name in form.labels or len(layout.columns) >= MAX_STREAM_COLUMNS:
        return None
    return replace(layout, form=replace(form, labels=(*form.labels, plot.name)), columns=(*layout.columns, column))
