"""What comes too fast is left out in whole lines, and every line is counted."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.live.lines import LiveLines
from kalscope.sources.port.reader import BytesReceived

ENDS = st.lists(st.sampled_from([b"\n", b"\r\n", b"\r"]), min_size=1, max_size=40)


@given(ENDS, st.lists(st.integers(1, 9), min_size=1), st.data())
def test_every_line_is_read_whole_or_counted(ends, sizes, data):
    """However fast the consumer is: the lines read and those dropped are the lines sent, none is half of two."""
    sent = list(range(100, 100 + len(ends)))
    stream = b"".join(b"%d" % number + end for number, end in zip(sent, ends, strict=True))
    lines, rows = LiveLines(ReadOptions()), []
    lines.opened(0.0, "at a line")

    at, cut = 0, 0
    while at < len(stream):
        piece = stream[at : at + sizes[cut % len(sizes)]]
        at, cut = at + len(piece), cut + 1
        if data.draw(st.booleans()):
            lines.overrun(piece)
        else:
            received = BytesReceived(piece, cut, cut + 1, 0.0)
            rows += [event.rows[0][0] for event in lines.feed(received) if event.kind == "row"]
    assert rows == sorted(set(rows) & set(sent))
    counts = lines.counts
    assert counts.received == len(sent)
    assert (counts.accepted, counts.rejected, counts.dropped) == (len(rows), 0, len(sent) - len(rows))
