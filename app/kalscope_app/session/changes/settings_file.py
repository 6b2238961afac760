"""A tuning file loaded in the dashboard: its q, r, p0 … become those of what is open."""

from __future__ import annotations

from kalscope.analysis.channel_kinds import default_channel
from kalscope.common.text import one_line
from kalscope.errors import BadFile, BadSetting
from kalscope.tuning.tuning import Tuning
from kalscope.tuning.tuning_file import loads
from kalscope_app.session.opening import adapted
from kalscope_app.session.state import Change, State

ENDING = ".toml"
"""What the name of a tuning file ends with; every other file is a recording."""

MAX_BYTES = 1_000_000
"""Bytes of an uploaded tuning file, at most; one of a thousand channels has 200 kB."""


def uploaded_settings(name: str, content: bytes) -> Tuning:
    """What an uploaded tuning file holds.

    Raises:
        BadFile: it is not a tuning file.
    """
    if len(content) > MAX_BYTES:
        raise BadFile(f"{name!r} must be a tuning file of at most 1 MB (got {len(content)} bytes)")
    try:
        return loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise BadFile(f"{name!r} must be a tuning file in UTF-8 (got other bytes)") from None
    except BadFile as error:
        raise BadFile(f"{name!r}: {error}") from None


def use_settings(tuning: Tuning, name: str) -> Change:
    """The values of a file become those of the channels of the same names; one undoable change.

    Args:
        tuning: what the file holds.
        name: what it is called.
    """

    def change(state: State) -> State:
        after = adapted(state, tuning)
        note = f"Loaded {one_line(name)[:80]}. {after.answers.note}".strip()
        return after.with_answers(note=note)

    return change


def as_it_was_left(tuning: Tuning) -> Change:
    """The filters that this file had when it was last open, unless others than the starting values are set now."""

    def change(state: State) -> State:
        settings = state.settings
        if state.recording.source != tuning.source or settings.tunings != settings.starts:
            return state
        try:
            after = adapted(state, tuning)
        except BadSetting:  # the file has other channels now
            return state
        if (after.settings.tunings, after.settings.fusion) == (settings.tunings, settings.fusion):
            return state
        if state.channel != default_channel(state.recording):  # chosen on the command line
            after = after.with_open(channel=state.channel)
        note = f"The filter is as you left it: Undo gives the starting values. {after.answers.note}".strip()
        return after.with_answers(note=note)

    return change
