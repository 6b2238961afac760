"""One page for the lab book: chart, parameters, numbers, verdicts and the command that reopens it all."""

from __future__ import annotations

from kalscope.export.report.content import Curves, Report, make_report
from kalscope.export.report.page import as_html
from kalscope.export.report.picture import as_png

__all__ = ["Curves", "Report", "as_html", "as_png", "make_report"]
