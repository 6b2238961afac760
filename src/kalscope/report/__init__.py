"""One page for the lab book: chart, parameters, numbers, verdicts and the command that reopens it all."""

from __future__ import annotations

from kalscope.report.content import Curves, Report, make_report
from kalscope.report.page import as_html
from kalscope.report.picture import as_png

__all__ = ["Curves", "Report", "as_html", "as_png", "make_report"]
