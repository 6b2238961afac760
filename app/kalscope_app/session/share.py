"""One line that reopens file, channel and setting: written from a State, and applied to one. Pure."""

from __future__ import annotations

import os
import shlex
import subprocess
from dataclasses import dataclass

from kalscope.filtering.classic import Chain
from kalscope.sources.grammar.read_options import option, option_words
from kalscope.tuning.tuning import chain_text, typed_chain
from kalscope_app.session.changes import channel_named, select_channel, typed_value
from kalscope_app.session.live_changes import when_settled
from kalscope_app.session.state import State

AUTOMATIC = {"p0": "automatic", "x0": "first", "gate": "off"}
"""The texts that mean no number."""


@dataclass(frozen=True)
class ShareLine:
    """The line, and what must be said with it."""

    line: str
    """The command."""
    remarks: tuple[str, ...]
    """Sentences on what it does not contain; fixed texts, with nothing from a file."""


def share_line(state: State) -> ShareLine:
    """The command that reopens what is on screen."""
    recording, remarks = state.recording, list[str]()
    source = f"./{recording.source}" if recording.source.startswith("-") else recording.source
    if not source.isprintable() or not source:
        source, remarks = "FILE", ["Replace FILE with the path of the open file."]
    words = ["kalscope", "open", source, *reading_words(state)]
    if len(recording.names) > 1:
        named = state.channel.isprintable() and state.channel.strip()
        words += option("channel", state.channel if named else str(state.index + 1))
    if state.fusion is not None:
        remarks.append("Fused sensors reopen with the tuning file above.")
    elif state.tuning.paper is not None:
        remarks.append("The Khan et al. filter reopens as its experiment has it.")
    else:
        words += setting_words(state)
    if len(recording.names) > 1:
        remarks.append("The other channels open at their starting values; the tuning file above keeps them all.")
    join = subprocess.list2cmdline if os.name == "nt" else shlex.join
    return ShareLine(join(words), tuple(remarks))


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
    words = () if state.typed_period is None else option("sample-period", repr(state.typed_period))
    return [*words, *option_words(state.options)]


def apply_options(state: State, channel: str | None, chain: str | None, **given: str | None) -> State:
    """The state with the channel and the setting of the command line; what is None stays as it was opened.

    Raises:
        BadSetting: no such channel, not a number, not a chain, or values that no filter can have.
    """
    values: dict[str, float | Chain | None] = {
        name: typed_value(name, text) for name, text in given.items() if text is not None
    }
    if values.get("p0", 0.0) is None:
        values["x0"] = None
    if chain is not None:
        values["chain"] = typed_chain(chain)

    def change(state: State) -> State:
        if channel is not None:
            state = select_channel(channel_named(state.recording, channel))(state)
        return state.with_tuning(**values, paper=None, how="command line") if values else state

    if values and state.live is not None and not state.live.settled:
        state.with_tuning(**values)  # refuses now what no channel could have
    return state if channel is None and not values else when_settled(state, change)
