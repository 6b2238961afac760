"""Kalscope: the scalar Kalman noise filter, headless.

Numbers in, numbers out: importing this package imports neither the dashboard nor the serial port.
"""

from __future__ import annotations

from kalscope.errors import BadDevice, BadFile, BadSetting, KalscopeError
from kalscope.filtering import FilterResult, KalmanFilter, denoise, kalman_filter
from kalscope.model import FilterParams, starting_params
from kalscope.recording import LineIssue, ReadReport, Recording
from kalscope.sources import list_samples, open_source, read_recording, synthesize
from kalscope.steady_state import SteadyState, ratio_for, steady_state
from kalscope.tuning import ChannelTuning, Tuning, load_tuning, save_tuning

__all__ = [
    "BadDevice",
    "BadFile",
    "BadSetting",
    "ChannelTuning",
    "FilterParams",
    "FilterResult",
    "KalmanFilter",
    "KalscopeError",
    "LineIssue",
    "ReadReport",
    "Recording",
    "SteadyState",
    "Tuning",
    "denoise",
    "kalman_filter",
    "list_samples",
    "load_tuning",
    "open_source",
    "ratio_for",
    "read_recording",
    "save_tuning",
    "starting_params",
    "steady_state",
    "synthesize",
]
