"""Pinned settings: in the Compare tab a table of them and what to do with one."""

from __future__ import annotations

from contextlib import AbstractContextManager

import viser

from kalscope.common.text import correlation, decibels, lag_text, number, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes import delete_variant, momentum_words, rename_variant, use_variant
from kalscope_app.session.session import Session
from kalscope_app.session.state import MAX_NAME_LENGTH, MAX_VARIANTS, Variant
from kalscope_app.studies.comparisons import Fit, VariantComparison, VariantRow
from kalscope_app.views.widgets import capitalised, escape_markdown, on_user

NOTHING = "–"

MAX_UNBROKEN = 20
"""Characters from which a cell of the table may break: the words of a chain."""

EMPTY = (
    "Nothing is pinned on this channel yet. **Pin**, in the Tune tab, keeps the current filter "
    "as A, so that you can compare later settings with it. "
    f"Up to {MAX_VARIANTS} can be pinned."
)

FOR_ONE_CHANNEL = "A setting of one channel can be pinned: choose one above the tabs."


class VariantsView:
    """The upper part of the Compare tab."""

    def __init__(self, gui: viser.GuiApi, compare_tab: AbstractContextManager[object], session: Session) -> None:
        self._session = session
        with compare_tab:
            gui.add_markdown("### Pinned settings")
            self._table = gui.add_markdown(EMPTY)
            folder = gui.add_folder("Change a pinned setting", visible=False)
            with folder as self._folder, gui.add_form(None) as form:
                self._which = gui.add_dropdown("setting", list[str]([NOTHING]), hint="One of the pinned settings.")
                self._steps = gui.add_button_group(
                    "",
                    ("Use", "Delete"),
                    hint="Use: tune with its q, r, momentum and initial state. Undo reverts both.",
                )
                self._name = gui.add_text(
                    "new name", "", hint=f"At most {MAX_NAME_LENGTH} characters; press Enter to rename the setting."
                )
        on_user(self._steps.on_click, lambda _client: self._use_or_delete())
        on_user(form.on_submit, lambda _client: self._rename())

    def _use_or_delete(self) -> None:
        change = {"Use": use_variant, "Delete": delete_variant}[self._steps.value]
        self._session.request(change(self._which.value))

    def _rename(self) -> None:
        if self._name.value.strip():
            self._session.request(rename_variant(self._which.value, self._name.value))

    def show(self, frame: Frame) -> None:
        """Offer the variants there are."""
        names = tuple(variant.name for variant in frame.state.variants)
        self._folder.visible = bool(names)
        before = tuple(self._which.options)
        if names and names != before:
            chosen = _follow(self._which.value, before, names)
            self._which.options = names
            self._which.value = chosen
            self._name.value = ""

    def show_table(self, table: VariantComparison) -> None:
        """Write the table."""
        self._table.content = table_text(table)


def _follow(chosen: str, before: tuple[str, ...], names: tuple[str, ...]) -> str:
    """What stays chosen when the names change: the same one, renamed or not; a new one as soon as it is there."""
    if len(names) > len(before) or before == (NOTHING,):
        return next(name for name in reversed(names) if name not in before)
    if chosen in names:
        return chosen
    return names[min(before.index(chosen), len(names) - 1)] if chosen in before else names[-1]


def table_text(table: VariantComparison) -> str:
    """The settings side by side, the present one first; markdown, names escaped."""
    if table.state.fusion is not None:
        return FOR_ONE_CHANNEL
    if not table.state.variants:
        return EMPTY
    with_truth = any(row.measures.rmse is not None for row in table.rows)
    unit = escape_markdown(table.state.tuning.unit, 12)
    head = ["", *(("filter",) if table.with_chain else ()), "q", "r"]
    head += [*(("τ",) if table.with_momentum else ()), "lag", "noise"]
    head += ["over\u00adshoot"] if table.with_momentum else []
    head += [f"RMSE {unit}".strip()] if with_truth else []
    head += ["NIS", "lag‑1 corr.", "log-likelihood"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    best = _best(table.rows)
    lines += ["| " + " | ".join(_cells(table, row, with_truth, best)) + " |" for row in table.rows]
    return "\n".join(lines) + "\n\n" + _explained(table, with_truth)


def _best(rows: tuple[VariantRow, ...]) -> tuple[float | None, float | None]:
    """The smallest RMSE, and the largest log-likelihood where all rows sum over the same samples."""
    errors = [row.measures.rmse for row in rows if row.measures.rmse is not None]
    fits = [row.measures.fit for row in rows if row.measures.fit]
    comparable = len({fit.scored for fit in fits}) == 1
    return min(errors, default=None), max(fit.loglik for fit in fits) if comparable else None


def _cells(
    table: VariantComparison, row: VariantRow, with_truth: bool, best: tuple[float | None, float | None]
) -> list[str]:
    measures, steady, chain = row.measures, row.measures.steady, row.tuning.chain
    period = table.state.recording.sample_period
    used = [number(row.tuning.q), number(row.tuning.r)]
    used += [momentum_words(row.tuning.momentum, period)] if table.with_momentum else []
    cells = [
        "**current**" if row.variant is None else mark(row.variant, dark=table.state.view.dark),
        *(("Kalman" if chain is None else capitalised(chain.words),) if table.with_chain else ()),
        *(used if chain is None or chain.then is None else "–" * len(used)),
        lag_text(steady.lag_samples, period),
        decibels(-steady.noise_reduction_db),
        *((percent(steady.overshoot),) if table.with_momentum else ()),
    ]
    if with_truth:
        cells.append("–" if measures.rmse is None else _bold(number(measures.rmse, 4), measures.rmse == best[0]))
    cells += ["–"] * 3 if measures.fit is None else _fit_cells(measures.fit, best[1])
    return [cells[0], *(cell if len(cell) > MAX_UNBROKEN else cell.replace(" ", "\u00a0") for cell in cells[1:])]


def _fit_cells(fit: Fit, best: float | None) -> list[str]:
    d = fit.diagnostics
    quiet = "✓" if abs(d.r1) <= d.r1_bound else "✗"
    return [number(d.nis), f"{correlation(d.r1)} {quiet}", _bold(number(fit.loglik, 6), fit.loglik == best)]


def mark(variant: Variant, *, dark: bool) -> str:
    """A spot of its colour and its name."""
    return f'<span style="color:{variant.css(dark=dark)}">■</span> **{escape_markdown(variant.name, 20)}**'


def _bold(text: str, chosen: bool) -> str:
    return f"**{text}**" if chosen else text


def _explained(table: VariantComparison, with_truth: bool) -> str:
    said = [
        "NIS is 1 where q and r have the right size; the lag‑1 correlation is near 0 (✓) for a white innovation."
    ]
    if with_truth:
        said.append("RMSE is the error against the truth; the smallest is bold.")
    if len({row.measures.fit.scored for row in table.rows if row.measures.fit}) == 1:
        said.append("The setting with the largest log-likelihood, in bold, explains the recording best.")
    else:
        said.append("The log-likelihoods sum over different samples and cannot be compared.")
    if table.with_chain:
        said.append("All three are for the Kalman filter alone.")
    return " ".join(said)
