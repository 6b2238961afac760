"""Kalscope: the scalar Kalman noise filter, headless.

Numbers in, numbers out: importing this package imports neither the dashboard nor the serial port.
"""

from __future__ import annotations

from kalscope.errors import BadDevice, BadFile, BadSetting, KalscopeError
from kalscope.filtering import FilterResult, KalmanFilter, denoise, kalman_filter
from kalscope.model import FilterParams, starting_params
from kalscope.recording import LineIssue, ReadReport, Recording
from kalscope.steady_state import SteadyState, ratio_for, steady_state

__all__ = [
    "BadDevice",
    "BadFile",
    "BadSetting",
    "FilterParams",
    "FilterResult",
    "KalmanFilter",
    "KalscopeError",
    "LineIssue",
    "ReadReport",
    "Recording",
    "SteadyState",
    "denoise",
    "kalman_filter",
    "ratio_for",
    "starting_params",
    "steady_state",
]
