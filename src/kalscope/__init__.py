"""Kalscope: the scalar Kalman noise filter, headless.

Numbers in, numbers out: importing this package imports neither the dashboard nor the serial port.
"""

from __future__ import annotations

from kalscope.diagnostics import Diagnostics, diagnose, diagnose_held_out
from kalscope.errors import BadDevice, BadFile, BadSetting, Cancelled, KalscopeError
from kalscope.estimation import (
    Estimate,
    compare_methods,
    estimate,
    estimate_fixed_r,
    estimate_fixed_ratio,
    noise_from_datasheet,
    noise_from_still,
    params_for_specification,
)
from kalscope.export import export_tuning
from kalscope.filtering import FilterResult, KalmanFilter, denoise, kalman_filter
from kalscope.likelihood import likelihood_profile, log_likelihood
from kalscope.model import FilterParams, starting_params
from kalscope.recording import LineIssue, ReadReport, Recording
from kalscope.smoothing import SmootherResult, smooth
from kalscope.sources import list_samples, open_source, read_recording, synthesize
from kalscope.sources.read_options import ReadOptions
from kalscope.steady_state import SteadyState, ratio_for, steady_state
from kalscope.tuning import ChannelTuning, Tuning, load_tuning, save_tuning

__all__ = [
    "BadDevice",
    "BadFile",
    "BadSetting",
    "Cancelled",
    "ChannelTuning",
    "Diagnostics",
    "Estimate",
    "FilterParams",
    "FilterResult",
    "KalmanFilter",
    "KalscopeError",
    "LineIssue",
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
    "export_tuning",
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
