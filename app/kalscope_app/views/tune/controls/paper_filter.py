"""The closed folder "Paper filter": the filter of Khan et al. in place of the one with q and r, for comparison."""

from __future__ import annotations

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.parameters import paper_filter, set_paper_text, set_variant_of_eq3
from kalscope_app.session.session import Session
from kalscope_app.views.binding import TypedNumber, bind

FILTERS: dict[str, str | None] = {
    "Kalman filter": None,
    "Khan et al. filter, eq. (3) as printed": "printed",
    "Khan et al. filter, eq. (3) corrected": "without_slip",
}
"""Filters by their labels, and the variant of equation (3) that each one uses."""

BOXES = (
    ("sigma_m", "measured error σM", "The only value that the paper changes from sensor to sensor; above 0."),
    ("sigma_e0", "initial error σE", "Empty: automatic."),
    ("e0", "initial estimate E", "Empty: the first sample."),
)
"""Name, label and hint of its parameters."""


class PaperFilterView:
    """Which filter runs, and the parameters of the other one."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder("Paper filter", expand_by_default=False) as self._folder:
            self._filter = gui.add_dropdown("filter", tuple(FILTERS), hint="Khan et al. filter: for comparison.")
            self._boxes = [
                TypedNumber(gui, session, name, label, hint, set_paper_text) for name, label, hint in BOXES
            ]
        bind(self._filter, session, lambda name: set_variant_of_eq3(FILTERS[name]))

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        self._folder.visible = frame.state.fusion is None
        paper = paper_filter(frame.state)
        reading = paper.reading if paper else None
        self._filter.value = next(name for name, value in FILTERS.items() if value == reading)
        for box, (name, _, _) in zip(self._boxes, BOXES, strict=True):
            box.set_visible(paper is not None)
            box.show(frame, None if paper is None else getattr(paper, name), "automatic")
