"""The filter as a pipe: one line of numbers in, one line of filtered numbers out. No input or output here."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from kalscope.common.text import plural
from kalscope.filtering.filter import KalmanFilter
from kalscope.filtering.params import FilterParams
from kalscope.filtering.protocol import Filter, StreamingFilter
from kalscope.sources.grammar.cells import is_comment, parse_number

Filters = Filter | Sequence[Filter] | FilterParams
"""One for as many channels as there are, one a channel, or one that fuses all of them."""

Update = Callable[[Sequence[float]], str]
"""Takes the samples of a line and gives its answer."""


class LineFilter:
    """Answers each line of comma-separated channels with the filtered values, in the same order, or with one.

    A cell without a number (empty, "nan") is a missing sample: its channel predicts, its answer is empty. Fused
    channels have one answer, empty where all of them are missing. A line that cannot be read is a missing sample of
    all channels; a comment (# % //) is not a sample, and its answer is empty.
    """

    def __init__(self, params: Filters) -> None:
        """Start the filters.

        Args:
            params: One filter for as many channels as the first readable line has; or one a channel; or one that
                fuses all channels.
        """
        self._params = params
        self._channels = _known_channels(params)
        """Numbers per line; 0 until the first readable line."""
        self._update = _start(params, self._channels)
        self._before = 0  # lines received while the number of channels was unknown
        self.received = 0
        """Lines received so far."""

    def answer(self, line: str) -> tuple[str, str]:
        """Take one line, with or without its newline.

        Returns:
            (answer, note): the filtered values, "" for a line without any; and for a line that cannot be read
            one sentence about it, else "".
        """
        self.received += 1
        text = line.strip().lstrip("\ufeff")  # PowerShell begins a pipe with a BOM
        if is_comment(text):
            return "", ""
        if not text:
            return self._miss(), ""
        values = [parse_number(cell.strip()) for cell in text.split(",")]
        samples = [value for value in values if value is not None]
        if len(samples) < len(values):
            return self._miss(), self._note("numbers with commas between them", text)
        if not self._channels:
            self._begin(len(samples))
        if len(samples) != self._channels:
            return self._miss(), self._note(plural(self._channels, "number"), text)
        return self._update(samples), ""

    def _begin(self, channels: int) -> None:
        self._channels, self._update = channels, _start(self._params, channels)
        for _ in range(self._before):
            self._miss()

    def _miss(self) -> str:
        self._before += not self._channels
        self._update([math.nan] * self._channels)
        return ""

    def _note(self, must: str, text: str) -> str:
        return f"line {self.received} must hold {must} (got {text[:60]!r}): taken as missing"


def _known_channels(params: Filters) -> int:
    """How many channels the filters are for; 0 = any number."""
    if isinstance(params, FilterParams):
        return params.sensors
    return len(params) if isinstance(params, Sequence) else 0


def _start(params: Filters, channels: int) -> Update:
    if isinstance(params, FilterParams):
        return _fused(params)
    return _each(params if isinstance(params, Sequence) else [params] * channels)


def _each(chosen: Sequence[Filter]) -> Update:
    """A filter a channel."""
    filters = [one.stream() for one in chosen]

    def answer(channel: StreamingFilter, sample: float) -> str:
        x = channel.update(sample)
        return "" if math.isnan(sample) else repr(float(x))

    return lambda samples: ",".join(map(answer, filters, samples))


def _fused(params: FilterParams) -> Update:
    """One filter for all channels."""
    fusion = KalmanFilter(params)

    def answer(samples: Sequence[float]) -> str:
        x = fusion.update(samples)
        return "" if all(map(math.isnan, samples)) else repr(float(x))

    return answer
