"""The filter as a pipe: one line of numbers in, one line of filtered numbers out. No input or output here."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kalscope.common.text import plural
from kalscope.filtering.params import FilterParams
from kalscope.filtering.streaming import KalmanFilter
from kalscope.sources.grammar.cells import is_comment, parse_number


class LineFilter:
    """Answers each line of comma-separated channels with the filtered values, in the same order.

    A cell without a number (empty, "nan") is a missing sample: its channel predicts, its answer is empty. A
    line that cannot be read is a missing sample of all channels; a comment (# % //) is no sample, and its
    answer is empty.
    """

    def __init__(self, params: FilterParams | Sequence[FilterParams]) -> None:
        """Start the filters.

        Args:
            params: One filter for as many channels as the first readable line has; or one a channel. Scalars.
        """
        self._params = params
        self._filters: list[KalmanFilter] = []
        self._before = 0  # lines received while the number of channels was unknown
        self._line = 0
        if not isinstance(params, FilterParams):
            self._filters = [KalmanFilter(each) for each in params]

    def answer(self, line: str) -> tuple[str, str]:
        """Take one line, with or without its newline.

        Returns:
            (answer, note): the filtered values, "" for a line without any; and for a line that cannot be read
            one sentence about it, else "".
        """
        self._line += 1
        text = line.strip().lstrip("\ufeff")  # PowerShell begins a pipe with a BOM
        if is_comment(text):
            return "", ""
        if not text:
            return self._miss(), ""
        values = [parse_number(cell.strip()) for cell in text.split(",")]
        samples = [value for value in values if value is not None]
        if len(samples) < len(values):
            return self._miss(), self._note("numbers with commas between them", text)
        if not self._filters:
            self._begin(len(samples))
        if len(samples) != len(self._filters):
            return self._miss(), self._note(plural(len(self._filters), "number"), text)
        return ",".join(map(_answer, self._filters, samples)), ""

    def _begin(self, channels: int) -> None:
        if isinstance(self._params, FilterParams):
            self._filters = [KalmanFilter(self._params) for _ in range(channels)]
        for _ in range(self._before):
            self._miss()

    def _miss(self) -> str:
        self._before += not self._filters
        for each in self._filters:
            each.update(math.nan)
        return ""

    def _note(self, must: str, text: str) -> str:
        return f"line {self._line} must hold {must} (got {text[:60]!r}): taken as missing"


def _answer(channel: KalmanFilter, sample: float) -> str:
    x = channel.update(sample)
    return "" if math.isnan(sample) else repr(float(x))
