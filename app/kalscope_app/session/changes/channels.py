"""Changes of the channels: which is on screen, which are linked, whose settings are copied."""

from __future__ import annotations

from kalscope.errors import BadSetting
from kalscope.recording import Recording
from kalscope_app.session.linked_channels import LINKS, scaled_copy
from kalscope_app.session.state import Change, State

ALL_OTHERS = "all other channels"


def select_channel(name: str) -> Change:
    """Show another channel, with its own parameters, or the fused value."""

    def change(state: State) -> State:
        fusion = state.settings.fusion
        fused = fusion is not None and name == fusion.tuning.name
        if not fused:
            state.recording.index(name)
        if fused is (state.fusion is not None) and (fused or name == state.channel):
            return state
        state = state.with_open(channel=state.channel if fused else name, fused=fused).with_reset_view()
        return state.with_answers(outcome=None, method_comparison=(), note="")

    return change


def channel_named(recording: Recording, text: str) -> str:
    """A channel by its name, or by its number from 1 where no channel is called so."""
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 6 else 0
    if text not in recording.names and 1 <= number <= len(recording.names):
        return recording.names[number - 1]
    return text


def set_link(link: str) -> Change:
    """Tune this channel alone or all together; all then take the present one's setting at once."""
    if link not in LINKS:
        raise BadSetting(f"the way of tuning channels must be one of {', '.join(LINKS)} (got {link[:40]!r})")

    def change(state: State) -> State:
        return state.with_settings(link=link).with_tuning_of(state.index, state.tuning).with_answers(note="")

    return change


def copy_setting(to: str) -> Change:
    """Copy the numbers of the channel on screen to another channel, or to all others."""

    def change(state: State) -> State:
        names, settings = state.recording.names, state.settings
        targets = [name for name in names if name != state.channel] if to == ALL_OTHERS else [to]
        chosen = {state.recording.index(name) for name in targets}
        tunings = tuple(
            scaled_copy(state.tuning, own) if i in chosen and names[i] != state.channel else own
            for i, own in enumerate(settings.tunings)
        )
        where = f"{len(chosen)} channels" if len(chosen) > 1 else "one channel"
        same = tunings == settings.tunings
        note = "" if same else f"The setting of {state.channel} was copied to {where}."
        return state.with_settings(tunings=tunings).with_answers(note=note)

    return change


def set_board_channel(name: str | None) -> Change:
    """Say which channel is the board's own filtered curve; None: there is none."""

    def change(state: State) -> State:
        if name is not None:
            state.recording.index(name)
        return state if name == state.board else state.with_open(board_choice=name)

    return change
