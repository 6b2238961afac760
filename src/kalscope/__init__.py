"""Kalscope: the scalar Kalman noise filter, headless.

Numbers in, numbers out: importing this package imports neither the dashboard nor the serial port. What a name needs
is imported when the name is first used: a program that only reads a tuning file does not wait for the compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kalscope.analysis.diagnostics import diagnose as diagnose
    from kalscope.analysis.fused import judge_fusion as judge_fusion
    from kalscope.catalogue import open_source as open_source
    from kalscope.errors import BadDevice as BadDevice
    from kalscope.errors import BadFile as BadFile
    from kalscope.errors import BadSetting as BadSetting
    from kalscope.errors import KalscopeError as KalscopeError
    from kalscope.estimation.fit import estimate as estimate
    from kalscope.estimation.fit import params_for_specification as params_for_specification
    from kalscope.estimation.fusion import estimate_fusion as estimate_fusion
    from kalscope.estimation.result import Estimate as Estimate
    from kalscope.export.registry import export_tuning as export_tuning
    from kalscope.filtering.filter import FilterResult as FilterResult
    from kalscope.filtering.filter import KalmanFilter as KalmanFilter
    from kalscope.filtering.filter import denoise as denoise
    from kalscope.filtering.filter import fuse as fuse
    from kalscope.filtering.filter import kalman_filter as kalman_filter
    from kalscope.filtering.filter import smooth as smooth
    from kalscope.filtering.params import FilterParams as FilterParams
    from kalscope.filtering.steady import ratio_for as ratio_for
    from kalscope.filtering.steady import steady_state as steady_state
    from kalscope.recording import Recording as Recording
    from kalscope.sources.grammar.read_options import ReadOptions as ReadOptions
    from kalscope.sources.reading.recording_file import read_recording as read_recording
    from kalscope.sources.synthetic import synthesize as synthesize
    from kalscope.tuned import TuneResult as TuneResult
    from kalscope.tuned import tune as tune
    from kalscope.tuning.file import load_tuning as load_tuning
    from kalscope.tuning.file import save_tuning as save_tuning
    from kalscope.tuning.tuning import ChannelTuning as ChannelTuning
    from kalscope.tuning.tuning import Tuning as Tuning

_NAMES = {
    "analysis.diagnostics": "diagnose",
    "analysis.fused": "judge_fusion",
    "catalogue": "open_source",
    "errors": "BadDevice BadFile BadSetting KalscopeError",
    "estimation.fit": "estimate params_for_specification",
    "estimation.fusion": "estimate_fusion",
    "estimation.result": "Estimate",
    "export.registry": "export_tuning",
    "filtering.filter": "FilterResult KalmanFilter denoise fuse kalman_filter smooth",
    "filtering.params": "FilterParams",
    "filtering.steady": "ratio_for steady_state",
    "recording": "Recording",
    "sources.grammar.read_options": "ReadOptions",
    "sources.reading.recording_file": "read_recording",
    "sources.synthetic": "synthesize",
    "tuned": "TuneResult tune",
    "tuning.file": "load_tuning save_tuning",
    "tuning.tuning": "ChannelTuning Tuning",
}
"""The names by the module that they come from."""

_MODULE_OF = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_MODULE_OF)  # pyright: ignore[reportUnsupportedDunderAll] - it reads the imports above


if not TYPE_CHECKING:  # with it, a type checker would accept every mistyped name

    def __getattr__(name: str) -> object:
        """A name of `__all__`, imported at its first use (PEP 562)."""
        if name == "__version__":
            from importlib.metadata import version

            return version(__name__)
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value

    def __dir__() -> list[str]:
        return sorted([*__all__, "__version__", "classic"])
