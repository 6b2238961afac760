"""The Check tab: the tests of the residuals behind the verdict."""

from __future__ import annotations

import numpy as np
import viser

from kalscope.analysis.correction import MIN_SAMPLES
from kalscope.analysis.diagnostics import expected_nis
from kalscope.common.array import Array
from kalscope.common.text import correlation, count, number, p_value, percent
from kalscope_app.studies.checks import Checks
from kalscope_app.studies.fusion import Judged
from kalscope_app.views.charts.chart import Chart, ChartLayout
from kalscope_app.views.charts.style import DARK, LIGHT, axes, line
from kalscope_app.views.tune.verdict import UNJUDGED


class ChecksView:
    """Table and chart in the Check tab."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._table = gui.add_markdown("")
        self._correlation = Chart(gui, 0.26)

    def show(self, checks: Checks | Judged | None) -> None:
        """Write and draw; the residuals of fused sensors have no such tests."""
        if not isinstance(checks, Checks):
            self._table.content = UNJUDGED
            self._correlation.hide()
            return
        self._table.content = table(checks)
        self._correlation.show(*correlation_lines(checks))


def correlation_lines(checks: Checks) -> tuple[Array, list[Array], ChartLayout]:
    """Autocorrelation of the innovation at lags 1 … h, and the 95 % bound of white noise."""
    d, palette = checks.all_samples, DARK if checks.state.view.dark else LIGHT
    lags = np.arange(1.0, len(d.correlation) + 1.0)
    bound = np.full(len(lags), d.r1_bound)
    marks = {"show": True, "size": 7, "space": 0, "fill": palette.innovation}
    layout = ChartLayout(
        (
            {"label": "lag (samples)"},
            line("−bound"),
            line("+bound"),
            {**line("autocorrelation of the innovation", palette.innovation), "points": marks},
        ),
        axes("autocorrelation"),
        ({"series": (2, 1), "fill": palette.innovation_band},),
    )
    return lags, [-bound, bound, d.correlation], layout


def table(checks: Checks) -> str:
    """Each test with the measured and the expected value; markdown."""
    d = checks.all_samples
    if d.n < MIN_SAMPLES:
        return f"**{checks.judgement.headline}**"
    half = "NIS of the second half" + (", fitted on the first" if checks.fitted_on_first_half else "")
    rows = [
        ("Size: mean of v²/s (NIS)", number(d.nis), expected_nis(d)),
        (half, number(checks.held_out.nis), expected_nis(checks.held_out)),
        ("Lag‑1 autocorrelation", correlation(d.r1), f"within ±{correlation(d.r1_bound)}"),
        ("Ljung-Box over several lags", p_value(d.ljung_box_p), "p above 0.05"),
        ("Spikes beyond 4 σ", count(d.spikes), f"about {number(d.spikes_expected, 2)}"),
        ("Low-frequency share of residual power", f"{percent(d.slow_share)}, {p_value(d.slow_p)}", "p above 0.05"),
        (
            "Last third compared with first",
            f"variance × {number(d.variance_ratio)}, {p_value(d.variance_ratio_p)}",
            "p above 0.05",
        ),
        ("Normality (skewness, excess kurtosis)", f"{number(d.skewness)}, {number(d.excess_kurtosis)}", "0, 0"),
    ]
    head = (
        f"**{checks.judgement.headline}**\n\n"
        f"If q and r fit, the innovation is white noise of the expected size. Tested on {count(d.n)} samples.\n\n"
        "| test | measured | expected (95\u00a0%) |\n|---|---|---|\n"
    )
    return head + "\n".join(f"| {name} | **{seen}** | {wanted} |" for name, seen, wanted in rows)
