"""One line that reopens file, channel and setting: written from a State, and applied to one. Pure."""

from __future__ import annotations

import os
import shlex
import subprocess
from dataclasses import dataclass

from kalscope.common.text import typed_number
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import option, option_words
from kalscope.tuning.tuning import chain_text, typed_chain
from kalscope_app.session.live_changes import when_settled, with_setting
from kalscope_app.session.state import Setting, State

AUTOMATIC = {"p0": "automatic", "x0": "first", "gate": "off"}
"""The texts that mean no number."""

NOTHING = {"p0": None, "x0": None, "gate": None, "momentum": 0.0}
"""The values that they stand for."""

WORDS_OF_NOTHING = ("", "automatic", "diffuse", "first", "off")
"""What a user may type for them."""


@dataclass(frozen=True)
class ShareLine:
    """The line, and what must be said with it."""

    line: str
    """The command."""
    remarks: tuple[str, ...]
    """Sentences on what it does not contain; fixed texts, with nothing from a file."""


def share_line(state: State) -> ShareLine:
    """The command that reopens what is on screen."""
    source, remarks = _source(state.recording)
    words = ["kalscope", "open", source, *reading_words(state), *_channel_words(state.recording, state.channel)]
    if state.fusion is not None:
        remarks.append("Fused sensors reopen with the tuning file above.")
    elif state.tuning.paper is not None:
        remarks.append("The Khan et al. filter reopens as its experiment has it.")
    else:
        words += setting_words(state)
    if len(state.recording.names) > 1:
        remarks.append("The other channels open at their starting values; the tuning file above keeps them all.")
    join = subprocess.list2cmdline if os.name == "nt" else shlex.join
    return ShareLine(join(words), tuple(remarks))


def _source(recording: Recording) -> tuple[str, list[str]]:
    source = recording.source
    if not source or not source.isprintable():
        return "FILE", ["Replace FILE with the path of the open file."]
    return (f"./{source}" if source.startswith("-") else source), []


def _channel_words(recording: Recording, channel: str) -> list[str]:
    if len(recording.names) == 1:
        return []
    index = recording.index(channel)
    return [*option("channel", channel if channel.isprintable() and channel.strip() else str(index + 1))]


def setting_words(state: State) -> list[str]:
    """Q and r always, the rest where it differs from the starting values."""
    tuning, start = state.tuning, state.start
    words = [*option("q", repr(tuning.q)), *option("r", repr(tuning.r))]
    by_value = tuning.p0 is not None
    for name in ("momentum", "p0", "x0", "gate"):
        value = getattr(tuning, name)
        if value != getattr(start, name) and (name != "x0" or by_value):
            words += option(name, AUTOMATIC[name] if value is None else repr(value))
    return words if tuning.chain is None else [*words, *option("chain", chain_text(tuning.chain))]


def reading_words(state: State) -> list[str]:
    """How the file is to be read, where that was decided."""
    period = state.open.typed_period
    words = () if period is None else option("sample-period", repr(period))
    return [*words, *option_words(state.open.options)]


def apply_options(state: State, channel: str | None, chain: str | None, **given: str | None) -> State:
    """The state with the channel and the setting of the command line; what is None stays as it was opened.

    Raises:
        BadSetting: no such channel, not a number, not a chain, or values that no filter can have.
    """
    values: Setting = {}
    for name, text in given.items():
        if text is not None:
            nothing = name in NOTHING and text.strip().lower() in WORDS_OF_NOTHING
            values[name] = NOTHING[name] if nothing else typed_number(name, text)
    if values.get("p0", 0.0) is None:
        values["x0"] = None
    if chain is not None:
        values["chain"] = typed_chain(chain)

    if values and state.live is not None and not state.live.settled:
        state.with_tuning(**values)  # refuses now what no channel could have
    nothing = channel is None and not values
    return state if nothing else when_settled(state, lambda state: with_setting(state, channel, values))
