"""The form that generates a synthetic signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kalscope.sources.synthetic import NOISES, SHAPES, SignalSettings
from kalscope_app.views.binding import on_user
from kalscope_app.views.text import typed

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

GENERATOR_LABELS = {
    "n": "samples",
    "sample_period": "sample period (s)",
    "channels": "channels",
    "amplitude": "amplitude",
    "level": "level",
    "period": "period (s)",
    "sigma": "noise σ",
    "outliers": "outliers (share)",
    "outlier_size": "outlier size",
    "quantum": "ADC step",
    "drop_outs": "drop-outs (share)",
    "seed": "seed",
}


class GeneratorForm:
    """The settings of a synthetic signal and the button that makes it."""

    def __init__(self, gui: viser.GuiApi, open_spec: Callable[[str], None]) -> None:
        self._open_spec = open_spec
        defaults = SignalSettings()
        docs = dict(setting_docs())
        self._shape = gui.add_dropdown("shape", SHAPES, initial_value=defaults.shape, hint=docs.get("shape"))
        self._noise = gui.add_dropdown("noise", NOISES, initial_value=defaults.noise, hint=docs.get("noise"))
        self._texts = {
            name: gui.add_text(label, typed(float(getattr(defaults, name))), hint=docs.get(name))
            for name, label in GENERATOR_LABELS.items()
        }
        button = gui.add_button("Generate", hint="Generate this signal and open it.")
        on_user(button.on_click, lambda _client: self._generate())

    def _generate(self) -> None:
        query = "&".join(f"{name}={text.value.strip()}" for name, text in self._texts.items())
        self._open_spec(f"synthetic:{self._shape.value}?noise={self._noise.value}&{query}")


def setting_docs() -> list[tuple[str, str]]:
    """Hint of each generator setting."""
    return [
        ("shape", "The noise-free signal, drawn dashed as the truth."),
        ("noise", "Law of the noise; triangular is rand − rand, as in the first paper."),
        ("n", "How many samples."),
        ("sample_period", "Time between two samples."),
        ("channels", "How many channels, 1 to 16, each with noise of its own."),
        ("amplitude", "Size of the shape."),
        ("level", "Value around which it swings."),
        ("period", "One cycle, the rise of a ramp, the moment of a step."),
        ("sigma", "Standard deviation of the noise; r of the filter is its square."),
        ("outliers", "Share of samples hit by a spike, 0 to 1."),
        ("outlier_size", "How far a spike goes, in the unit of the signal."),
        ("quantum", "Step of the analogue-to-digital converter; 0 for none."),
        ("drop_outs", "Share of samples that are missing, 0 to 1."),
        ("seed", "The same seed makes the same signal."),
    ]
