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
    from kalscope.analysis.fused import FusionJudgement, judge_fusion
    from kalscope.catalogue import open_source
    from kalscope.errors import BadDevice, BadFile, BadSetting, Cancelled, KalscopeError
    from kalscope.estimation.estimate import estimate
    from kalscope.estimation.fleet.many.estimate_many import estimate_many
    from kalscope.estimation.fleet.many.table import EstimateTable
    from kalscope.estimation.fusion.estimate_fusion import estimate_fusion
    from kalscope.estimation.fusion.result import FusionEstimate
    from kalscope.estimation.known import estimate_fixed_r, estimate_fixed_ratio, params_for_specification
    from kalscope.estimation.likelihood.profile import log_likelihood
    from kalscope.estimation.momentum.profile import likelihood_profile
    from kalscope.estimation.result import Estimate
    from kalscope.estimation.sensor.noise import noise_from_datasheet, noise_from_still
    from kalscope.estimation.sensor.starting import starting_params
    from kalscope.export.registry import export_tuning
    from kalscope.filtering.classic.chain import Chain
    from kalscope.filtering.classic.stages import (
        Butterworth,
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
    from kalscope.filtering.steady_state import SteadyState, ratio_for, steady_state
    from kalscope.recording import LineIssue, ReadReport, Recording
    from kalscope.sources.grammar.read_options import ReadOptions
    from kalscope.sources.readers.recording_file import read_recording
    from kalscope.sources.samples import list_samples
    from kalscope.sources.synthetic import synthesize
    from kalscope.tuning.tuning import ChannelTuning, Tuning
    from kalscope.tuning.tuning_file import load_tuning, save_tuning

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
    "FusionEstimate",
    "FusionJudgement",
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
    "analysis.estimators": ("compare_methods",),
    "analysis.diagnostics": (
        "Diagnostics",
        "diagnose",
        "diagnose_held_out",
    ),
    "analysis.fused": (
        "FusionJudgement",
        "judge_fusion",
    ),
    "catalogue": ("open_source",),
    "errors": (
        "BadDevice",
        "BadFile",
        "BadSetting",
        "Cancelled",
        "KalscopeError",
    ),
    "estimation.estimate": ("estimate",),
    "estimation.fleet.many.estimate_many": ("estimate_many",),
    "estimation.fleet.many.table": ("EstimateTable",),
    "estimation.fusion.estimate_fusion": ("estimate_fusion",),
    "estimation.fusion.result": ("FusionEstimate",),
    "estimation.known": (
        "estimate_fixed_r",
        "estimate_fixed_ratio",
        "params_for_specification",
    ),
    "estimation.likelihood.profile": ("log_likelihood",),
    "estimation.momentum.profile": ("likelihood_profile",),
    "estimation.result": ("Estimate",),
    "estimation.sensor.noise": (
        "noise_from_datasheet",
        "noise_from_still",
    ),
    "estimation.sensor.starting": ("starting_params",),
    "export.registry": ("export_tuning",),
    "filtering.classic.chain": ("Chain",),
    "filtering.classic.stages": (
        "Butterworth",
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
    "filtering.steady_state": (
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
    "sources.readers.recording_file": ("read_recording",),
    "sources.samples": ("list_samples",),
    "sources.synthetic": ("synthesize",),
    "tuning.tuning": (
        "ChannelTuning",
        "Tuning",
    ),
    "tuning.tuning_file": (
        "load_tuning",
        "save_tuning",
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
