"""The form that generates a synthetic signal."""

from __future__ import annotations

from collections.abc import Callable

import viser

from kalscope.sources.synthetic import NOISES, SHAPES, SignalSettings
from kalscope_app.session.session import Failed
from kalscope_app.views.binding import on_user, typed

SETTINGS = {
    "n": ("samples", "Number of samples."),
    "sample_period": ("sample period (s)", "Time between two samples."),
    "channels": ("channels", "Number of channels, 1 to 16, each with its own noise."),
    "amplitude": ("amplitude", "Size of the shape."),
    "level": ("level", "Mean of the signal."),
    "period": ("period (s)", "One cycle, the rise time of a ramp, the time of a step."),
    "sigma": ("noise σ", "Standard deviation of the noise; r of the filter is its square."),
    "outliers": ("outliers (share)", "Share of samples that are outliers, 0 to 1."),
    "outlier_size": ("outlier size", "Size of an outlier, in the unit of the signal."),
    "quantum": ("ADC step", "Step of the analogue-to-digital converter; 0 for none."),
    "drop_outs": ("drop-outs (share)", "Share of samples that are missing, 0 to 1."),
    "seed": ("seed", "The same seed gives the same signal."),
}
"""Label and hint of each number of `SignalSettings`."""


class GeneratorForm:
    """The settings of a synthetic signal and the button that generates it."""

    def __init__(self, gui: viser.GuiApi, open_spec: Callable[[str, Failed], None]) -> None:
        self._open_spec = open_spec
        defaults = SignalSettings()
        self._shape = gui.add_dropdown(
            "shape",
            SHAPES,
            initial_value=defaults.shape,
            hint="The noise-free signal, plotted dashed as the truth.",
        )
        self._noise = gui.add_dropdown(
            "noise",
            NOISES,
            initial_value=defaults.noise,
            hint="Distribution; triangular is rand − rand (Ma'arif 2019).",
        )
        self._texts = {
            name: gui.add_text(label, typed(float(getattr(defaults, name))), hint=hint)
            for name, (label, hint) in SETTINGS.items()
        }
        button = gui.add_button("Generate", hint="Generate this signal and open it.")
        on_user(button.on_click, lambda _client: self._generate())

    def _generate(self) -> None:
        query = "&".join(f"{name}={text.value.strip()}" for name, text in self._texts.items())
        self._open_spec(f"synthetic:{self._shape.value}?noise={self._noise.value}&{query}", Failed.GENERATE)
