"""The answer of `kalscope tune --json`: everything, in values that JSON can hold."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, cast

from kalscope.analysis.actions import Action
from kalscope.analysis.diagnostics import Diagnostics
from kalscope.analysis.estimators import is_within
from kalscope.analysis.judge import advice_words
from kalscope.cli.tune.advice import option_for
from kalscope.cli.tune.answer import Answer
from kalscope.estimation.finding import METHOD_NAMES
from kalscope.estimation.result import Estimate
from kalscope.estimation.verdict.conclude import gain_of, lag_of
from kalscope.filtering.params import FilterParams
from kalscope.recording import Recording


def as_plain(answer: Answer, recording: Recording) -> dict[str, Any]:
    """The answer in values that JSON can hold: None for what is missing, "inf" for infinity, never NaN."""
    params, limits, judged = answer.found.params, answer.range, answer.judgement
    return finite(
        {
            "channel": answer.channel,
            "unit": answer.unit,
            "samples": answer.samples,
            "missing": answer.missing,
            "sample_period": answer.sample_period,
            **_pair(params),
            "verdict": answer.verdict,
            "message": answer.found.message,
            "how": answer.found.how,
            "ratio_interval": limits.ratio_interval,
            "gain_interval": limits.gain_interval,
            "lag_interval": limits.lag_interval,
            "momentum_interval": limits.momentum_interval,
            "prediction_gain": limits.prediction_gain,
            "set_aside": _set_aside(answer.found.estimate),
            "steady": None if answer.steady is None else asdict(answer.steady),
            "opinions": [_opinion(one, answer.opinions[0]) for one in answer.opinions],
            "advice": None if judged.residuals is None else advice_words(judged),
            "judgement": _judgement(answer, recording),
            "residuals": _tested(judged.residuals),
            "held_out": _tested(judged.held_out),
        }
    )


def _pair(params: FilterParams | None) -> dict[str, Any]:
    names = ("q", "r", "ratio", "momentum", "gate")
    return {name: None if params is None else getattr(params, name) for name in names}


def _set_aside(fit: Estimate | None) -> dict[str, Any] | None:
    """The samples that the spike-proof fit set aside, and the fit to all of them; None where it was not used."""
    if fit is None or fit.outliers is None:
        return None
    plain = {"q": fit.plain_q, "r": fit.plain_r, "momentum": fit.plain_momentum}
    return {"samples": fit.outliers.nonzero()[0].tolist(), "share": fit.outlier_share, "plain": plain}


def _opinion(one: Estimate, best: Estimate) -> dict[str, Any]:
    names = ("method", "q", "r", "ratio", "q_se", "r_se", "loglik", "verdict", "message")
    values = {name: getattr(one, name) for name in names}
    ratio = float(one.ratio)
    values |= {"name": METHOD_NAMES[one.method], "gain": gain_of(ratio), "lag_samples": lag_of(ratio)}
    return {**values, "within_interval": is_within(one, best)}


def _judgement(answer: Answer, recording: Recording) -> dict[str, Any]:
    judged = answer.judgement
    advice = [
        {"text": one.text, "action": _action(one.action), "option": option_for(one.action, answer, recording)}
        for one in judged.findings
    ]
    return {"status": judged.status, "headline": judged.headline, "advice": advice}


def _action(action: Action | None) -> dict[str, Any] | None:
    return None if action is None else {"name": type(action).__name__, **asdict(action)}


def _tested(judged: Diagnostics | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    names = (
        *("n", "advice", "nis", "nis_low", "nis_high", "r1", "r1_bound", "ljung_box", "ljung_box_p"),
        *("spikes", "spikes_expected", "jumps", "variance_ratio", "variance_ratio_p", "q_factor", "r_factor"),
    )
    return {name: getattr(judged, name) for name in names}


def finite(value: Any) -> Any:
    """The value without numbers that JSON cannot hold; numpy types become Python's."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in cast("list[Any]", value)]
    if isinstance(value, float):
        number = float(value)
        return None if math.isnan(number) else number if math.isfinite(number) else str(number)
    return finite(value.tolist()) if hasattr(value, "tolist") else value
