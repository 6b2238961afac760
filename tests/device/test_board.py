"""The simulated board behaves at its port as a real one: reset, boot, unplug, replug, wrong speed."""

from __future__ import annotations

import pytest
import serial
from board import FLAT_OUT, read_lines
from waiting import PATIENCE, wait_until

from kalscope.sources.reading.line_parser import LineParser

pytestmark = pytest.mark.device
BANNER = b"# kalscope_stream\r\n"


def test_opening_the_port_resets_the_board_and_its_boot_takes_its_time(start_board, stream_sketch):
    board = start_board(stream_sketch, range(1024), "--reset-on-open", "--hold", 0.05)
    for _ in range(2):  # the board looks at its port once in a millisecond: it may not see that it was closed
        wait_until(lambda: read_lines(board.port, 3)[0] == BANNER, "the banner", pause=0.05)
    assert board.stop()["resets"] == 2


def test_the_reset_button_starts_the_sketch_again(start_board, stream_sketch):
    board = start_board(stream_sketch, range(1024), "--wait-open")
    with serial.Serial(board.port, 115200, timeout=PATIENCE) as port:
        assert port.readline() == BANNER
        board.reset()
        # What was on its way is lost, as it would be: the banner may follow the piece of a line.
        assert any(port.readline().endswith(BANNER) for _ in range(1000))


def test_pulling_the_plug_hangs_up_and_the_same_port_comes_back(start_board, stream_sketch):
    board = start_board(stream_sketch, range(1024), *FLAT_OUT)
    with serial.Serial(board.port, 115200, timeout=PATIENCE) as port:
        assert port.readline() == BANNER
        board.unplug()
        with pytest.raises(serial.SerialException):
            port.read(1_000_000)
    with pytest.raises(serial.SerialException):
        serial.Serial(board.port)
    again = start_board(stream_sketch, range(1024), *FLAT_OUT)
    assert again.port == board.port
    assert read_lines(again.port, 1) == [BANNER]


def test_at_the_wrong_speed_no_line_can_be_read(start_board, stream_sketch):
    board = start_board(stream_sketch, range(1024), "--check-baud", *FLAT_OUT)
    with serial.Serial(board.port, 9600, timeout=PATIENCE) as port:
        heard = port.read(1000)
    parser = LineParser()
    parser.feed(heard)
    assert len(heard) == 1000
    assert "row" not in {event.kind for event in parser}


def test_two_runs_flat_out_send_the_same_bytes(start_board, stream_sketch):
    first, second = (start_board(stream_sketch, range(1024), *FLAT_OUT, name=name) for name in ("one", "two"))
    assert read_lines(first.port, 150) == read_lines(second.port, 150)
