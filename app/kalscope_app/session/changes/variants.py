"""Changes of the pinned settings."""

from __future__ import annotations

from dataclasses import replace

from kalscope.errors import BadSetting
from kalscope.tuning.paper_tuning import PaperTuning
from kalscope_app.session.state import Change, State
from kalscope_app.session.variants import Variant, checked_name, pinned

PARAMETERS = ("q", "r", "momentum", "p0", "x0", "gate", "chain")
"""What a setting consists of."""


def pin_present(state: State) -> State:
    """Keep the present setting of the channel on screen as a variant, under the first free letter."""
    state.require_one_channel()
    if isinstance(state.tuning, PaperTuning):
        raise BadSetting("the Khan et al. filter has no q and r, so it cannot be pinned")
    same = next((one for one in state.variants if one.tuning.filter == state.filter), None)
    if same is not None:
        raise BadSetting(f"this setting is pinned already, as {same.name}")
    pin = pinned(state.tuning, state.variants)
    return state.with_settings(pins=(*state.settings.pins, pin)).with_answers(note="")


def use_variant(name: str) -> Change:
    """The present setting becomes that of a variant."""

    def change(state: State) -> State:
        tuning = _variant(state, name).tuning
        values = {key: getattr(tuning, key) for key in PARAMETERS}
        return state.with_standard_filter().with_tuning(**values, how=tuning.how)

    return change


def rename_variant(name: str, new: str) -> Change:
    """Rename a variant."""

    def change(state: State) -> State:
        variant = _variant(state, name)
        bare = checked_name(new, (one.name for one in state.variants if one is not variant))
        return _with(state, variant, (replace(variant, name=bare),))

    return change


def delete_variant(name: str) -> Change:
    """Forget a variant; its letter and colour are free again."""
    return lambda state: _with(state, _variant(state, name), ())


def _variant(state: State, name: str) -> Variant:
    for variant in state.variants:
        if variant.name == name:
            return variant
    choices = ", ".join(variant.name for variant in state.variants) or "none, nothing is pinned"
    raise BadSetting(f"variant must be one of {choices} (got {name[:40]!r})")


def _with(state: State, old: Variant, new: tuple[Variant, ...]) -> State:
    pins = state.settings.pins
    at = next(i for i, one in enumerate(pins) if one is old)
    return state.with_settings(pins=(*pins[:at], *new, *pins[at + 1 :])).with_answers(note="")
