"""Record what a board sends: the name of the file, the buttons, and the status of the recording."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import viser

from kalscope.common.text import count
from kalscope.sources.live.live_status import RecordingStatus
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live.recording import BoardRecording, account
from kalscope_app.session.live_state import ConnectionState
from kalscope_app.session.session import Failed
from kalscope_app.views.binding import on_user
from kalscope_app.views.markdown import escape_markdown


class RecordingView:
    """The last part of the folder "Live board". Starting and stopping are jobs."""

    def __init__(
        self, gui: viser.GuiApi, jobs: Jobs, recording: BoardRecording, open_spec: Callable[[str, Failed], None]
    ) -> None:
        """Args: the usual; the recording; opens the file at a path."""
        self._board_recording = recording
        self._text = gui.add_markdown("")
        self._name = gui.add_text(
            "record to", recording.name, hint="A new file in the folder in which Kalscope was started."
        )
        self._record = gui.add_button("Record", visible=False, hint="Every line as received, before any filter.")
        self._stop = gui.add_button("Stop recording", visible=False, hint="Ends and closes the file.")
        on_user(
            self._record.on_click,
            lambda _client: jobs.run(partial(recording.start, self._name.value.strip()), Failed.RECORD),
        )
        on_user(self._stop.on_click, lambda _client: jobs.run(recording.stop, Failed.RECORD))
        self._open = gui.add_button(
            "Open the recording", visible=False, hint="In place of the board; q, r, p0 and pins stay."
        )
        on_user(self._open.on_click, lambda _client: open_spec(str(recording.last), Failed.OPEN))
        recording.on_change = self._on_change

    def _on_change(self, status: RecordingStatus | None) -> None:
        """Show a recording whatever is on screen: the engine draws nothing while a file is."""
        self._text.content = recording_text(status)
        if status is None:
            self._name.value = self._board_recording.name

    def show(self, connection: ConnectionState, source: str) -> None:
        """Offer what can be done now; `source` is what is on screen."""
        ready = connection.connected and not connection.recording
        self._name.visible = self._record.visible = ready
        self._stop.visible = connection.recording
        last = self._board_recording.last
        self._open.visible = last is not None and not connection.recording and str(last) != source


def recording_text(recording: RecordingStatus | None) -> str:
    """The status of the recording, as markdown; the name of the file is escaped."""
    if recording is None:
        return ""
    lines = [f"recording to **{escape_markdown(recording.name)}**", account(recording.counts)]
    if recording.counts.waiting:
        lines.append(f"{count(recording.counts.waiting)} lines wait in memory")
    lines += [f"**{escape_markdown(text, 200)}**" for text in (recording.error, recording.warning) if text]
    return "\n".join(f"- {line}" for line in lines)
