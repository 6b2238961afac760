"""What comes too fast is left out in whole lines, and every line is counted."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.port import events
from kalscope.sources.port.events import BytesReceived, LineCounter, LinesDropped, Overload

PIECES = st.lists(st.binary(min_size=1, max_size=12) | st.text("1,\r\n", min_size=1, max_size=12).map(str.encode))
LINE_END = re.compile(rb"\r\n|\r|\n")


@given(PIECES)
def test_lines_are_counted_wherever_the_stream_is_cut(pieces):
    counter = LineCounter()
    assert sum(map(counter.count, pieces)) == len(LINE_END.findall(b"".join(pieces)))


ENDS = st.lists(st.sampled_from([b"\n", b"\r\n", b"\r"]), min_size=1, max_size=40)


@given(ENDS, st.lists(st.integers(1, 9), min_size=1), st.data())
def test_every_line_is_handed_over_whole_or_counted(ends, sizes, data):
    """However fast the consumer is: the lines kept and those dropped are the lines sent, none is half of two."""
    lines = [b"%d" % number for number in range(100, 100 + len(ends))]
    stream = b"".join(line + end for line, end in zip(lines, ends, strict=True))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(events, "MAX_WAITING_BYTES", 40)
        queue, gate, at = [], Overload(), 0
        for i in range(len(stream)):
            piece, at = stream[at : at + sizes[i % len(sizes)]], at + sizes[i % len(sizes)]
            if piece:
                queue += gate.take(BytesReceived(piece, i, i + 1, 0.0), data.draw(st.sampled_from([0, 25, 60])))
        queue += gate.end()
    runs, dropped = [b""], 0
    for item in queue:
        if isinstance(item, LinesDropped):
            dropped += item.count
            runs.append(b"")
        else:
            runs[-1] += item.data
    kept = [line for run in runs for line in LINE_END.split(run)[:-1]]
    assert len(kept) + dropped == len(lines)
    assert set(kept) <= set(lines)
    assert kept == sorted(kept)


def test_a_consumer_that_keeps_up_gets_the_very_items():
    gate = Overload()
    items = [BytesReceived(b"1,2\n" * 1000, i, i + 1, 0.0) for i in range(10)]
    assert [next(iter(gate.take(item, 4000))) for item in items] == items
    assert list(gate.end()) == []


def test_bytes_without_an_end_of_a_line_are_named():
    gate = Overload()
    late = events.MAX_WAITING_BYTES
    assert list(gate.take(BytesReceived(b"7" * 100, 0.0, 1.0, 0.0), late)) == []
    assert gate.is_endless
    assert list(gate.take(BytesReceived(b"7\n8", 1.0, 2.0, 0.0), late)) == []
    assert not gate.is_endless
    assert gate.dropped == 1
    gap, kept = gate.take(BytesReceived(b"9\n10\n", 2.0, 3.0, 0.0), 0)
    assert gap == LinesDropped(2, 0.0, 3.0)
    assert kept.data == b"10\n"


TICK, LINE = 0.01, b"1234,56\n"


class Flow:
    """Lines into a gate every 10 ms, and a consumer behind it."""

    def __init__(self):
        self.gate, self.at, self.waiting, self.kept, self.dropped = Overload(), 0.0, 0.0, 0, 0

    def run(self, seconds, *, sent, taken):
        """So many bytes a second come and are taken; the most that waited in the last quarter."""
        most = 0.0
        for step in range(count := round(seconds / TICK)):
            self.at, self.waiting = self.at + TICK, max(self.waiting - taken * TICK, 0.0)
            piece = LINE * round(sent * TICK / len(LINE))
            for item in self.gate.take(BytesReceived(piece, self.at - TICK, self.at, 0.0), round(self.waiting)):
                if isinstance(item, LinesDropped):
                    self.dropped += item.count
                else:
                    self.waiting += len(item.data)
                    self.kept += len(item.data) // len(LINE)
            most = max(most, self.waiting) if step >= 0.75 * count else most
        return most


@pytest.mark.parametrize("taken", [50_000, 200_000])
def test_after_the_first_overload_no_more_waits_than_is_taken_in_a_second_or_two(taken, monkeypatch):
    monkeypatch.setattr(events, "MAX_WAITING_BYTES", 1 << 20)
    flow = Flow()
    assert flow.run(40.0, sent=800_000, taken=taken) < 1.5 * taken
    assert flow.kept + flow.dropped + flow.gate.dropped == 40 * 800_000 // len(LINE)
    assert flow.kept * len(LINE) > 0.95 * 40.0 * taken  # the consumer never waits


def test_a_consumer_that_had_nothing_to_do_is_not_taken_for_a_slow_one():
    flow = Flow()
    flow.run(20.0, sent=800_000, taken=400_000)
    flow.run(20.0, sent=8_000, taken=400_000)
    dropped = flow.dropped
    assert dropped > 0
    assert flow.run(1.0, sent=600_000, taken=400_000) > 100_000
    assert (flow.dropped, flow.gate.dropped) == (dropped, 0)


def test_a_minute_without_a_dropped_line_gives_the_whole_room_back():
    flow = Flow()
    flow.run(20.0, sent=800_000, taken=400_000)
    flow.run(events.HOLD_S + 20.0, sent=8_000, taken=400_000)
    dropped = flow.dropped
    assert flow.run(2.0, sent=1_600_000, taken=100_000) > 2_500_000
    assert (flow.dropped, flow.gate.dropped) == (dropped, 0)
