"""The status of a live source: its counts, and a sentence for the user if something is wrong."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from kalscope.common.text import count
from kalscope.sources.live.lines import LineCounts
from kalscope.sources.live.samples import LiveSamples
from kalscope.sources.port.events import PortState, Word
from kalscope.sources.port.reader import PortReader
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.recorder import Recorder, RecorderCounts

_RATE_OVER = 2.0
"""Seconds over which the lines per second are averaged."""
_RATE_EVERY = 0.1
"""Seconds between two counts that are kept for this."""
_SILENT_AFTER = 5.0
"""Seconds after which a source that should send is reported as silent, and the step of that time."""
_MIN_LINES_JUDGED = 20
"""Lines among which one with numbers is expected."""


@dataclass(frozen=True)
class RecordingStatus:
    """The status of an active recording."""

    name: str
    """Name of the file that is written now, without its folder."""
    counts: RecorderCounts
    """Its counts: received = written + rejected + dropped, always."""
    error: str
    """What keeps lines from reaching the disk; "" where nothing does."""
    warning: str
    """A warning that the disk will soon be full; "" where it will not."""


@dataclass(frozen=True)
class LiveStatus:
    """The status of a live source. received = accepted + rejected + dropped, always."""

    word: Word
    """closed, connecting, connected, or "disconnected, waiting"."""
    hint: str
    """A sentence for the user: what is wrong and what to do; "" if nothing is."""
    port: str
    """What is open, or was open last."""
    since: float
    """Monotonic time of the change to this state, s."""
    received: int
    """Lines that arrived."""
    lines_per_s: float
    """Lines a second, over the last 2 s."""
    period: float | None
    """Measured sample period in s, the median step; None before two samples."""
    jitter: float | None
    """Half the width that holds nine of ten steps, in s; None before ten steps."""
    device_time: bool
    """True where the time is the board's own, false where it is that of arrival."""
    accepted: int
    """Lines that became samples."""
    rejected: int
    """Lines that should have become samples and did not."""
    dropped: int
    """Other lines: comments, headers, boot text, the first line after each opening, torn ones, `overrun`."""
    overrun: int
    """Of the dropped lines, those that came faster than they could be processed."""
    reconnects: int
    """How many times the port was opened again."""
    left_memory: int
    """Samples of this generation that are no longer kept."""
    max_read_latency: float
    """Upper bound of the longest time for which bytes waited to be read, s."""
    recording: RecordingStatus | None = None
    """The active recording; None if there is none."""


def status_of(
    reader: PortReader,
    counts: LineCounts,
    samples: LiveSamples,
    rate: float,
    noise: bool,
    recorder: Recorder | None,
) -> LiveStatus:
    """The status of a source.

    Args:
        reader: Reads its port.
        counts: Its lines.
        samples: Its samples.
        rate: Lines a second.
        noise: Whether the bytes are not text.
        recorder: The active one.
    """
    state, time = reader.state, samples.time
    return LiveStatus(
        word=state.word,
        hint=silence_text(*reader.silence)
        or hint_of(state, reader.spec, counts, noise=noise, endless=reader.is_endless),
        port=state.device,
        since=state.since,
        received=counts.received,
        lines_per_s=rate if state.word == "connected" else 0.0,
        period=time.period,
        jitter=time.jitter,
        device_time=time.by_device,
        accepted=counts.accepted,
        rejected=counts.rejected,
        dropped=counts.dropped,
        overrun=counts.overrun,
        reconnects=max(state.opened - 1, 0),
        left_memory=samples.left_memory,
        max_read_latency=reader.max_read_latency,
        recording=None if recorder is None else recording_status(recorder),
    )


def hint_of(state: PortState, spec: PortSpec, counts: LineCounts, *, noise: bool, endless: bool) -> str:
    """What is wrong with a port and what to do, in a sentence; "" where nothing is.

    Args:
        state: The state of the port.
        spec: What was to be opened.
        counts: The lines that arrived.
        noise: Whether the bytes are not text.
        endless: Whether they have no line ends.
    """
    if state.reason:
        return state.reason
    if noise:
        cause = f": is {spec.baud} the right baud rate?" if spec.transport.has_baud else ""
        return f"the data is not text{cause}"
    if state.word != "connected":
        return ""
    if endless:
        return "megabytes arrive without a line end: is this a board that prints lines?"
    if counts.received - counts.overrun > _MIN_LINES_JUDGED and not counts.accepted:
        return "lines arrive, but none has numbers"
    return overrun_text(counts.overrun)


def silence_text(seconds: float, check: str) -> str:
    """A sentence that nothing has arrived for so long, and what to check; "" where that is short, or usual."""
    if not check or seconds < _SILENT_AFTER:
        return ""
    minutes, steps = int(seconds // 60), int(seconds // _SILENT_AFTER)  # in steps: a running number distracts
    return f"nothing has arrived for {f'{minutes} min' if minutes else f'{steps * _SILENT_AFTER:g} s'}: {check}"


def overrun_text(lines: int) -> str:
    """A sentence that so many lines came faster than they could be processed; "" for none."""
    return f"the port sends faster than it can be read: {count(lines)} lines dropped" if lines else ""


def recording_status(recorder: Recorder) -> RecordingStatus:
    """The current status of a recording."""
    return RecordingStatus(recorder.paths[-1].name, recorder.counts, recorder.error, recorder.warning)


class LineRate:
    """Lines a second over the last seconds. One thread writes, any may read."""

    def __init__(self) -> None:
        self._noted: deque[tuple[float, int]] = deque()
        self.now = 0.0
        """Lines a second."""

    def note(self, at: float, received: int) -> None:
        """Note how many lines had arrived at the monotonic time `at`, s."""
        noted = self._noted
        if not noted or at - noted[-1][0] >= _RATE_EVERY:
            noted.append((at, received))
        while len(noted) > 2 and at - noted[1][0] > _RATE_OVER:
            noted.popleft()
        (begin, old), (end, new) = noted[0], noted[-1]
        self.now = (new - old) / (end - begin) if end > begin else 0.0
