"""Pinned settings: in the Compare tab a table of them and what to do with one."""

from __future__ import annotations

from contextlib import AbstractContextManager

import viser

from kalscope.common.text import correlation, lag_text, noise_left, number, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes import delete_variant, momentum_words, use_variant
from kalscope_app.session.session import Session
from kalscope_app.session.state import MAX_VARIANTS, Variant
from kalscope_app.studies.comparisons import VariantComparison, VariantRow
from kalscope_app.views.widgets import capitalised, escape_markdown, offer, on_user, table_of

NOTHING = "–"

EMPTY = (
    "Nothing is pinned on this channel yet. **Pin**, in the Tune tab, keeps the current filter as A, so that "
    f"you can compare later settings with it. Up to {MAX_VARIANTS} can be pinned."
)

FOR_ONE_CHANNEL = "A setting of one channel can be pinned: choose one above the tabs."


class VariantsView:
    """The upper part of the Compare tab."""

    def __init__(self, gui: viser.GuiApi, compare_tab: AbstractContextManager[object], session: Session) -> None:
        self._session = session
        with compare_tab:
            gui.add_markdown("### Pinned settings")
            self._table = gui.add_markdown(EMPTY)
            with gui.add_folder("Change a pinned setting", visible=False) as self._folder:
                self._which = gui.add_dropdown("setting", list[str]([NOTHING]), hint="One of the pinned settings.")
                hint = "Use: tune with its q, r, momentum and initial state. Undo reverts both."
                self._steps = gui.add_button_group("", ("Use", "Delete"), hint=hint)
        on_user(self._steps.on_click, lambda _client: self._use_or_delete())

    def _use_or_delete(self) -> None:
        change = {"Use": use_variant, "Delete": delete_variant}[self._steps.value]
        self._session.request(change(self._which.value))

    def show(self, frame: Frame) -> None:
        """Offer the variants there are."""
        names = tuple(variant.name for variant in frame.state.variants) or (NOTHING,)
        self._folder.visible = names != (NOTHING,)
        new, chosen = set(names).difference(self._which.options), self._which.value
        offer(self._which, names, max(new) if new else chosen if chosen in names else names[-1])

    def show_table(self, table: VariantComparison) -> None:
        """Write the table."""
        self._table.content = table_text(table)


EXPLAINED = (
    "NIS is 1 where q and r have the right size; the lag‑1 correlation is near 0 (✓) for a white innovation. "
    "Both are for the Kalman filter alone. "
)

COMPARED = {
    True: "The setting with the largest log-likelihood explains the recording best.",
    False: "The log-likelihoods sum over different samples and cannot be compared.",
}
"""What the log-likelihoods tell, by whether all sum over the same samples."""


def table_text(table: VariantComparison) -> str:
    """The settings side by side, the present one first; markdown, names escaped."""
    if table.state.fusion is not None:
        return FOR_ONE_CHANNEL
    if not table.state.variants:
        return EMPTY
    scored = {row.measures.scored for row in table.rows if row.measures.fit}
    lines = table_of([_cells(table, row) for row in table.rows])
    return f"{lines}\n\n{EXPLAINED}{COMPARED[len(scored) < 2]}"


def _cells(table: VariantComparison, row: VariantRow) -> dict[str, str]:
    """The cells of a setting by their columns; "" where it has no such number."""
    measures, tuning, fit = row.measures, row.tuning, row.measures.fit
    steady, period, chain = measures.steady, table.state.recording.sample_period, row.tuning.chain
    used = chain is None or chain.then is None
    unit = escape_markdown(table.state.tuning.unit, 12)
    quiet = "✓" if fit is not None and abs(fit.r1) <= fit.r1_bound else "✗"
    return {
        "": "**current**" if row.variant is None else mark(row.variant, dark=table.state.view.dark),
        "filter": ("Kalman" if chain is None else capitalised(chain.words)) if table.with_chain else "",
        "q": number(tuning.q) if used else "",
        "r": number(tuning.r) if used else "",
        "τ": momentum_words(tuning.momentum, period) if used and tuning.momentum else "",
        "lag": lag_text(steady.lag_samples, period),
        "noise left": noise_left(steady.noise_reduction_db),
        "over\u00adshoot": percent(steady.overshoot) if steady.overshoot else "",
        f"RMSE {unit}".strip(): "" if measures.rmse is None else number(measures.rmse, 4),
        "NIS": "" if fit is None else number(fit.nis),
        "lag‑1 corr.": "" if fit is None else f"{correlation(fit.r1)} {quiet}",
        "log-likelihood": "" if fit is None else number(measures.loglik, 6),
    }


def mark(variant: Variant, *, dark: bool) -> str:
    """A spot of its colour and its name."""
    return f'<span style="color:{variant.css(dark=dark)}">■</span> **{escape_markdown(variant.name, 20)}**'
