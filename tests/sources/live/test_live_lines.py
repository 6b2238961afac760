"""Lines of a port, each in one count, and the samples of a stream, timed truly after every pause."""

from __future__ import annotations

import math
import re
from itertools import accumulate, cycle, islice, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.live.lines import LineCounts, LiveLines
from kalscope.sources.live.samples import ArrivedRow, LiveSamples, LiveTime, SampleStore
from kalscope.sources.port.reader import BytesReceived
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.reading.line_parser import LineParser

ESP32 = b"""ets Jul 29 2019 12:21:46\r
\r
rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT)\r
configsip: 0, SPIWP:0xee\r
clk_drv:0x00,q_drv:0x00,d_drv:0x00,cs0_drv:0x00,hd_drv:0x00,wp_drv:0x00\r
mode:DIO, clock div:1\r
load:0x3fff0030,len:1184\r
load:0x40078000,len:13232\r
entry 0x400805e4\r
"""


class Stream:
    """Lines of one port, and what came of them."""

    def __init__(self, at=0.0):
        self.lines, self.now, self.events = LiveLines(ReadOptions()), at, []
        self.lines.opened(at)

    def feed(self, data, after=0.001, silence=None):
        begin, self.now = self.now, self.now + after
        silence = after if silence is None else silence
        self.events += self.lines.feed(BytesReceived(data, begin, self.now, silence))
        return self

    def reopen(self, after=1.0):
        self.lines.interrupted()
        self.now += after
        self.lines.opened(self.now)
        return self

    @property
    def rows(self):
        return [event.rows[0] for event in self.events if event.kind == "row"]

    @property
    def names(self):
        layout = self.lines.layout
        return [layout.columns[i].name for i in layout.channels]


def whole_lines(data):
    return len(re.split(rb"\r\n|\n|\r", data)) - 1


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_the_first_line_after_opening_is_dropped_wherever_the_bytes_are_cut(end):
    data = end.join([b"9", b"1,2", b"3,4", b"5,6"]) + end
    for cut in range(1, len(data)):
        stream = Stream().feed(data[:cut]).feed(data[cut:]).feed(b"7,8" + end)
        stream.feed(b"7,8" + end, after=3.0)
        assert stream.events[0].kind == "blank"  # counted, and in no file of rejected lines
        assert stream.rows[:3] == [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)], cut
        counts = stream.lines.counts
        assert counts.received == counts.accepted + counts.rejected + counts.dropped
        assert counts.received >= 5


NAMED, PLAIN, SINES = ["heat", "light"], ["value 1", "value 2"], ["sine 1", "sine 2"]
STREAMS = {
    "names after a silence": ([(b"heat,light\n1,2\n3,4\n", 1.6)], NAMED, [(1, 2), (3, 4)]),
    "no first sample, though": ([(b"1,2\n3,4\n", 1.6)], PLAIN, [(3, 4)]),
    "a cut line of names": ([(b"ght\n1,2\n3,4\n", 0.01)], PLAIN, [(1, 2), (3, 4)]),
    "names with blanks and digits": ([(b"x\nsine 1,sine 2\n0.5,0.25\n1,2\n", 1.6)], SINES, [(0.5, 0.25), (1, 2)]),
    "a board that starts twice": ([(b"x\n" + b"sine 1,sine 2\n" * 2 + b"0.5,0.25\n", 1.6)], SINES, [(0.5, 0.25)]),
    "boot text": ([(b"\x80\xff", 0), (ESP32, 0.4), (b"a:1,b:2\r\na:3,b:4\r\n", 0.5)], ["a", "b"], [(1, 2), (3, 4)]),
    "words among the numbers": ([(b"x\nheat,light\n1,2\n3,4\n", 0.1), (b"5,6\nERR,OK\n7,8\n", 3),
        (b"9,10\n", 0.1)], NAMED, [(1, 2), (3, 4), (5, 6), (7, 8), (9, 10)]),
}  # fmt: skip


@pytest.mark.parametrize("name", STREAMS)
def test_which_lines_are_names_and_which_are_samples(name):
    pieces, names, rows = STREAMS[name]
    stream = Stream()
    for data, after in pieces:
        stream.feed(data, after)
    counts, lines = stream.lines.counts, whole_lines(b"".join(data for data, _ in pieces))
    assert (stream.names, stream.rows) == (names, rows)
    assert (counts.rejected, counts.dropped) == (0, lines - len(rows))


@pytest.mark.parametrize(("silence", "unplugged", "rows"), [
    (None, False, [511, 512, 514]),  # a reset
    (0.1, False, [511, 512, 513, 514]),  # this machine reads late
    (0.1, True, [511, 512, 514]),
])  # fmt: skip
def test_a_line_that_the_board_did_not_end_is_never_joined_to_the_next(silence, unplugged, rows):
    stream = Stream().feed(b"x\n511\n512\n5", 0.1)
    if unplugged:
        stream.reopen()
    stream.feed(b"13\n514\n", 1.5, silence=silence)
    assert stream.rows == [(row,) for row in rows]
    assert stream.lines.counts.received == 5 + unplugged


def test_the_names_stay_when_the_board_comes_back_with_or_without_its_header():
    stream = Stream().feed(b"x\nms,heat,light\n1,2,3\n2,3,4\n", 0.1)
    layout = stream.lines.layout
    stream.reopen().feed(b"x\nms,heat,light\n1,2,3\n", 0.1).reopen().feed(b"x\n7,8,9\n", 0.1)
    assert stream.lines.layout is layout
    assert [row[0] for row in stream.rows] == [1, 2, 1, 7]
    assert stream.lines.counts.rejected == 0


@pytest.mark.parametrize("mark", [b"", b"# "])  # the exported sketches write their names as a comment
def test_a_header_in_mid_stream_is_no_row_and_names_what_had_no_names(mark):
    stream = Stream().feed(b"x\n1,2\n3,4\n", 0.1).feed(b"5,6\n", 30.0)
    assert stream.names == ["value 1", "value 2"]
    for remark in (b"# ready,set,go\n", b"# a r=1,q=2\n"):  # of another number of names, or with values
        assert stream.feed(remark).feed(b"5,6\n").names == ["value 1", "value 2"]
    stream.feed(mark + b"raw,filtered\n7,8\n9,10\n")
    assert stream.names == ["raw", "filtered"]
    assert stream.rows == [(1.0, 2.0), (3.0, 4.0), *3 * [(5.0, 6.0)], (7.0, 8.0), (9.0, 10.0)]
    stream.feed(mark + b"raw,filtered\n11,12\n")
    assert stream.rows[-1] == (11.0, 12.0)
    assert not np.isnan(stream.rows).any()


SEED = b"# boot\r\nms,a,b\r\n" + b"".join(b"%d,%d,%d\r\n" % (i, i * 3 % 7, i) for i in range(40))
PLACES = st.lists(st.integers(0, len(SEED)), max_size=12)


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(0, len(SEED)), st.binary(max_size=6))), PLACES, st.floats(0.001, 2.5))
def test_every_line_that_came_is_in_one_count(damage, cuts, pause):
    data = bytearray(SEED)
    for at, extra in damage:
        data[at : at + len(extra) // 2] = extra
    data = bytes(data)
    stream = Stream()
    for begin, end in pairwise([0, *sorted(cuts), len(data)]):
        if end > begin:  # \r at the end of a piece may belong to \r\n
            stream.feed(data[begin:end], pause)
    stream.lines.interrupted()
    counts, kinds = stream.lines.counts, [event.kind for event in stream.events]
    torn = data[-1:] not in (b"\n", b"\r", b"")
    assert counts.received == whole_lines(data) + torn == len(kinds) + torn
    accepted, rejected = kinds.count("row"), kinds.count("rejected")
    rest = counts.received - accepted - rejected
    assert (counts.accepted, counts.rejected, counts.dropped) == (accepted, rejected, rest)


@pytest.mark.slow
@pytest.mark.parametrize("row", ["{}.5,{}.25", "{} {}", "[{}, {}]", "c:{},d:{}", ",".join(["{}.125"] * 60)])
@pytest.mark.parametrize("before", ["{}.5,{}.25,1", "{}.5,{}.25", "a:{},b:{}", '{{"a": {}, "b": {}}}'])
def test_whatever_program_was_on_the_board_the_next_one_is_read(before, row):
    """Also where its lines are longer than the 200 characters to which an event quotes them."""
    stream = Stream().feed(b"x\n", after=3.0)
    for form in (before, row):
        for i in range(40):
            stream.feed((form.format(*((7 * i + 3 * k) % 11 for k in range(60))) + "\n").encode())
    assert stream.events[-1].kind == "row"
    assert np.count_nonzero(np.isfinite(stream.events[-1].rows[0])) == row.count("{}")


ENDS = st.lists(st.sampled_from([b"\n", b"\r\n", b"\r"]), min_size=1, max_size=40)


@pytest.mark.slow
@given(ENDS, st.lists(st.integers(1, 9), min_size=1), st.data())
def test_every_line_is_read_whole_or_counted(ends, sizes, data):
    """However fast the consumer is: the lines read and those dropped are the lines sent, none is half of two."""
    sent = list(range(100, 100 + len(ends)))
    stream = b"".join(b"%d" % number + end for number, end in zip(sent, ends, strict=True))
    lines, rows = LiveLines(ReadOptions()), []
    lines.opened(0.0, "at a line")
    for cut, (begin, end) in enumerate(pairwise(accumulate(islice(cycle(sizes), len(stream)), initial=0))):
        if data.draw(st.booleans()):
            lines.overrun(stream[begin:end])
        else:
            events = lines.feed(BytesReceived(stream[begin:end], cut, cut + 1, 0.0))
            rows += [event.rows[0][0] for event in events if event.kind == "row"]
    assert rows == sorted(set(rows) & set(sent))
    counts = lines.counts
    assert counts.received == len(sent)
    assert (counts.accepted, counts.rejected, counts.dropped) == (len(rows), 0, len(sent) - len(rows))
    lines.opened(0.0, "at a line")
    assert list(lines.feed(BytesReceived(b"1\r", 0, 1, 0.0)))
    assert lines.overrun(b"\n2\r\n3\n") == 2


NAN = math.nan
MS = TimeColumn(0, "number", "ms")


def test_a_topic_that_is_new_later_gets_a_column_and_the_others_keep_their_samples():
    samples, parser = LiveSamples(PortSpec("mqtt://broker/#"), 4), LineParser()

    def say(at, line):
        parser.feed(line)
        event = parser.next_line()
        samples.keep([(at, event)], parser.layout)
        return samples.snapshot(LineCounts())

    for at in range(1, 5):
        before = say(at, b">a:%d\n" % at)
    after = say(5, b">b:50\n")
    assert (after.generation > before.generation, after.first, after.recording.names) == (True, 0, ("a", "b"))
    np.testing.assert_array_equal(after.recording.values, [[1, NAN], [2, NAN], [3, NAN], [4, NAN], [NAN, 50]])
    np.testing.assert_array_equal(after.recording.time, np.arange(5))
    np.testing.assert_array_equal(before.recording.values, [[1], [2], [3], [4]])
    again = say(6, b">c:600\n")  # 5 rows fit, 4 are to be kept: the first two leave
    assert (again.first, again.recording.names) == (2, ("a", "b", "c"))
    np.testing.assert_array_equal(again.recording.values[[0, -1]], [[3, NAN, NAN], [NAN, NAN, 600]])


def numbered(begin, end):
    numbers = np.arange(begin, end, dtype=float)
    return numbers / 10, np.column_stack([numbers, -numbers])


@pytest.mark.slow
@given(st.integers(1, 50), st.lists(st.integers(0, 60), max_size=20))
def test_the_last_samples_are_kept_in_order_and_views_never_change(keep, pieces):
    store, came, views = SampleStore(2, keep), 0, []
    for count in pieces:
        store.append(*(part.tolist() for part in numbered(came, came + count)))
        came += count
        assert store.end == came
        assert min(keep, came) <= len(store) <= keep + max(keep // 4, 1)
        views.append((store.views(), numbered(store.first, came)))
    for found, expected in views:
        for view, numbers in zip(found, expected, strict=True):
            np.testing.assert_array_equal(view, numbers)
            assert not view.flags.writeable


def rows(hosts, stamps):
    return [ArrivedRow(*row, (float(i),)) for i, row in enumerate(zip(hosts, stamps, strict=True))]


def times_of(clock, hosts, stamps):
    return np.array(clock.place(rows(hosts, stamps))[0])


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
@pytest.mark.parametrize("is_named", [True, False])
def test_stamps_are_the_time_and_a_unit_without_name_is_found_by_the_clock_of_the_host(unit, scale, is_named):
    true = np.arange(200) * 0.01
    for speed in (1.0, 12.0):
        clock = LiveTime(TimeColumn(0, "number", unit if is_named else ""))
        time = times_of(clock, (7 + true / speed).tolist(), (true / scale).tolist())
        np.testing.assert_allclose(time, true, atol=1e-9)


TICKS = np.arange(100) * 0.01
DAMAGED = np.arange(20) * 10.0
DAMAGED[[7, 13]] = 99_999_999.0, 20.0
LATE = TICKS + 0.004 * (np.arange(100) % 3)
CLOCKS = {  # the column, when the rows arrived, s, their stamps, and the right times
    "stamps that stand still are no time": (TimeColumn(0, "number", ""), TICKS, [3.0] * 100, TICKS),
    "a counter that wraps": (MS, LATE, np.mod(TICKS * 1000 + 2.0**32 - 500, 2.0**32), TICKS),
    "a clock at midnight": (TimeColumn(0, "clock"), LATE, np.mod(86399.5e6 + 1e6 * TICKS, 86400e6), TICKS),
    "damaged stamps": (MS, TICKS[:20], DAMAGED, TICKS[:20]),
    "a board that restarts": (
        *(MS, [0, 0.01, 1.62, 1.634, 1.64, 1.65], [50_000.0, 50_010, 3, 13, 23, 33]),
        [0, 0.01, 1.62, 1.634, 1.644, 1.654],
    ),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_goes_on_by_the_time_that_has_passed(name):
    column, hosts, stamps, expected = CLOCKS[name]
    time = times_of(LiveTime(column), list(hosts), list(stamps))
    np.testing.assert_allclose(time, expected, atol=0.02 if name == "damaged stamps" else 1e-6)
    assert (np.diff(time) >= 0).all()


@pytest.mark.parametrize("column", [None, MS])
@pytest.mark.parametrize("restarted", [False, True])
def test_after_an_interruption_time_jumps_by_the_true_pause_and_one_row_is_missing(column, restarted):
    clock = LiveTime(column)
    times_of(clock, [0.0, 0.01, 0.02], [70_000.0, 70_010.0, 70_020.0])
    clock.interrupt()
    start = 80_000.0 if restarted else 130_020.0
    time, values = clock.place(rows([60.02, 60.03], [start, start + 10]))
    np.testing.assert_allclose(time, [0.03, 60.02, 60.03], atol=1e-6)
    assert math.isnan(values[0][0])
    assert values[1:] == [(0.0,), (1.0,)]
    assert clock.period == pytest.approx(0.01)
