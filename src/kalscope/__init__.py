"""Kalscope: the scalar Kalman noise filter, headless.

Numbers in, numbers out: importing this package imports neither the dashboard nor the serial port. What a name needs
is imported when the name is first used: a program that only reads a tuning file does not wait for the compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kalscope.analysis.diagnostics import Diagnostics, diagnose, diagnose_held_out
    from kalscope.analysis.estimators import compare_methods
    from kalscope.analysis.fused import judge_fusion
    from kalscope.analysis.judge import Judgement
    from kalscope.catalogue import open_source
    from kalscope.errors import BadDevice, BadFile, BadSetting, Cancelled, KalscopeError
    from kalscope.estimation.fit import estimate, estimate_fixed_r, estimate_fixed_ratio, params_for_specification
    from kalscope.estimation.fusion import estimate_fusion
    from kalscope.estimation.likelihood import log_likelihood
    from kalscope.estimation.many import EstimateTable, estimate_many
    from kalscope.estimation.momentum import likelihood_profile
    from kalscope.estimation.noise import noise_from_datasheet, noise_from_still, starting_params
    from kalscope.estimation.result import Estimate
    from kalscope.export.registry import export_tuning
    from kalscope.filtering.classic import (
        Butterworth,
        Chain,
        Exponential,
        Median,
        MovingAverage,
        OneEuro,
        PowerOfTwo,
    )
    from kalscope.filtering.filter import (
        FilterResult,
        KalmanFilter,
        SmootherResult,
        denoise,
        fuse,
        kalman_filter,
        smooth,
    )
    from kalscope.filtering.params import FilterParams
    from kalscope.filtering.steady import SteadyState, ratio_for, steady_state
    from kalscope.recording import LineIssue, ReadReport, Recording
    from kalscope.sources.grammar.read_options import ReadOptions
    from kalscope.sources.reading.recording_file import read_recording
    from kalscope.sources.samples import list_samples
    from kalscope.sources.synthetic import synthesize
    from kalscope.tuning.file import load_tuning, save_tuning
    from kalscope.tuning.tuning import ChannelTuning, Tuning

__all__ = [
    "BadDevice",
    "BadFile",
    "BadSetting",
    "Butterworth",
    "Cancelled",
    "Chain",
    "ChannelTuning",
    "Diagnostics",
    "Estimate",
    "EstimateTable",
    "Exponential",
    "FilterParams",
    "FilterResult",
    "Judgement",
    "KalmanFilter",
    "KalscopeError",
    "LineIssue",
    "Median",
    "MovingAverage",
    "OneEuro",
    "PowerOfTwo",
    "ReadOptions",
    "ReadReport",
    "Recording",
    "SmootherResult",
    "SteadyState",
    "Tuning",
    "compare_methods",
    "denoise",
    "diagnose",
    "diagnose_held_out",
    "estimate",
    "estimate_fixed_r",
    "estimate_fixed_ratio",
    "estimate_fusion",
    "estimate_many",
    "export_tuning",
    "fuse",
    "judge_fusion",
    "kalman_filter",
    "likelihood_profile",
    "list_samples",
    "load_tuning",
    "log_likelihood",
    "noise_from_datasheet",
    "noise_from_still",
    "open_source",
    "params_for_specification",
    "ratio_for",
    "read_recording",
    "save_tuning",
    "smooth",
    "starting_params",
    "steady_state",
    "synthesize",
]

_NAMES = {
    "analysis.diagnostics": (
        "Diagnostics",
        "diagnose",
        "diagnose_held_out",
    ),
    "analysis.estimators": ("compare_methods",),
    "analysis.fused": ("judge_fusion",),
    "analysis.judge": ("Judgement",),
    "catalogue": ("open_source",),
    "errors": (
        "BadDevice",
        "BadFile",
        "BadSetting",
        "Cancelled",
        "KalscopeError",
    ),
    "estimation.fit": (
        "estimate",
        "estimate_fixed_r",
        "estimate_fixed_ratio",
        "params_for_specification",
    ),
    "estimation.fusion": ("estimate_fusion",),
    "estimation.likelihood": ("log_likelihood",),
    "estimation.many": (
        "EstimateTable",
        "estimate_many",
    ),
    "estimation.momentum": ("likelihood_profile",),
    "estimation.noise": (
        "noise_from_datasheet",
        "noise_from_still",
        "starting_params",
    ),
    "estimation.result": ("Estimate",),
    "export.registry": ("export_tuning",),
    "filtering.classic": (
        "Butterworth",
        "Chain",
        "Exponential",
        "Median",
        "MovingAverage",
        "OneEuro",
        "PowerOfTwo",
    ),
    "filtering.filter": (
        "FilterResult",
        "KalmanFilter",
        "SmootherResult",
        "denoise",
        "fuse",
        "kalman_filter",
        "smooth",
    ),
    "filtering.params": ("FilterParams",),
    "filtering.steady": (
        "SteadyState",
        "ratio_for",
        "steady_state",
    ),
    "recording": (
        "LineIssue",
        "ReadReport",
        "Recording",
    ),
    "sources.grammar.read_options": ("ReadOptions",),
    "sources.reading.recording_file": ("read_recording",),
    "sources.samples": ("list_samples",),
    "sources.synthetic": ("synthesize",),
    "tuning.file": (
        "load_tuning",
        "save_tuning",
    ),
    "tuning.tuning": (
        "ChannelTuning",
        "Tuning",
    ),
}
"""The names by the module that they come from."""

_MODULE_OF = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}


if not TYPE_CHECKING:  # with it, a type checker would accept every mistyped name

    def __getattr__(name: str) -> object:
        """A name of `__all__`, imported at its first use (PEP 562)."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
