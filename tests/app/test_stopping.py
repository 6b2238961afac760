"""Ctrl+C, SIGTERM and the end of the terminal: every command ends, whatever comes in, and a recording is whole.

How long it takes is shown by `benchmarks/stopping.py`; here a program that does not end fails after PATIENCE.
"""

from __future__ import annotations

import os
import re
import signal
import socket
from contextlib import ExitStack
from itertools import count, cycle, product
from pathlib import Path

import pytest
from tests.app.wire import Guest
from tests.support.floods import FLOODS, Flood
from tests.support.line_sender import line_sender
from tests.support.program import end, is_free, labels, link_of, next_line, port_of, running, start, token_of
from tests.support.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")

SIGNALS = {"Ctrl+C": signal.SIGINT, "SIGTERM": signal.SIGTERM, "SIGHUP": signal.SIGHUP}
TAKEN = 1 << 17
"""Bytes after which a command is in the middle of what comes in."""
FROM_SOCKET = """
import os, socket
import kalscope.cli.filter as command
os.dup2(socket.create_connection(("127.0.0.1", {port})).detach(), 0)
sys.stdin, lines_of = open(0), command._bounded_lines
command._bounded_lines = lambda stream: (os.write(1, b"reads\\n"), lines_of(stream))[1]
"""
"""Makes standard input of the flood."""


def told_three_times(program, by):
    """Its status and output, after the same signal came three times: the second must not make it worse."""
    for _ in range(2):
        program.send_signal(by)
    return end(program, by)


EACH_FLOOD = pytest.mark.parametrize(
    ("flood", "by"), [*zip(FLOODS, [*SIGNALS, *SIGNALS], strict=True)], ids=lambda one: one.replace(" ", "-")
)


def left_in(folder):
    """Files in the folder, but for those of the program itself."""
    return {path.name for at in (folder, folder / "tmp") for path in at.iterdir()} - {"state", "tmp"}


@EACH_FLOOD
def test_a_filter_of_lines_ends_whatever_comes_in(flood, by, tmp_path):
    """Nobody reads its answers: it may wait for that, too."""
    piece = FLOODS[flood]
    with Flood(piece) as sender:
        change = FROM_SOCKET.format(port=sender.port)
        with start(tmp_path, "filter", "-", "--q", "1", "--r", "1", source=None, change=change) as program:
            assert next_line(program) == "reads\n"
            wait_until(lambda: sender.sent > TAKEN or not piece, "its lines")
            status, _, err = told_three_times(program, SIGNALS[by])
    assert status == 128 + SIGNALS[by]
    (last,) = [line for line in err.splitlines() if not re.fullmatch(r"kalscope: line \d+ must hold .*", line)]
    assert re.fullmatch(rf"kalscope: stopped by {re.escape(by)}: [\d\u202f]+ lines answered", last)
    assert left_in(tmp_path) == set()


@EACH_FLOOD
def test_a_recording_ends_whole_whatever_comes_in(flood, by, tmp_path):
    piece = FLOODS[flood]
    with Flood(piece) as sender:
        port = f"socket://127.0.0.1:{sender.port}"
        with start(tmp_path, "record", port, "-o", "run.csv", source=None) as program:
            wait_until((tmp_path / "run.csv").exists, "the recording")
            wait_until(lambda: sender.sent > TAKEN or not piece, "its lines")
            status, out, err = told_three_times(program, SIGNALS[by])
    assert (status, "Traceback" in err) == (0, False)
    account = re.search(r"received (\d+) lines = (\d+) written \+ (\d+) rejected \+ (\d+) dropped", out)
    received, written, rejected, dropped = map(int, account.groups())
    assert received == written + rejected + dropped
    lines = (tmp_path / "run.csv").read_bytes().splitlines(keepends=True)
    assert re.fullmatch(rb"# end: .*\n", lines[-1])
    if flood == "lines":
        assert sum(not line.startswith(b"#") for line in lines) == 1 + written


@pytest.mark.parametrize("by", SIGNALS)
def test_a_recording_whose_board_does_not_answer_ends_before_it_began(by, tmp_path):
    """A host that lets nobody in: what connects waits."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as full, ExitStack() as waiting:
        for _ in range(4):  # fill the queue: Linux answers no further one
            one = waiting.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex(full.getsockname())
        change = "from kalscope.sources.port.reader import PortReader\nopened = PortReader.start\n"
        change += "PortReader.start = lambda *a, **k: (print('opening', flush=True), opened(*a, **k))[1]"
        port = f"socket://127.0.0.1:{full.getsockname()[1]}"
        with start(tmp_path, "record", port, "-o", "run.csv", source=None, change=change) as program:
            assert next_line(program) == "opening\n"
            assert told_three_times(program, SIGNALS[by]) == (128 + SIGNALS[by], "", said(by))
    assert left_in(tmp_path) == set()


def said(by):
    return f"kalscope: stopped by {by}: no file is left half-written\n"


BUSY = {
    "a loop of Python": "print('busy', flush=True) or [None for _ in iter(int, 1)]",
    "a loop that nothing can interrupt": "print('busy', flush=True) or hashlib.pbkdf2_hmac('md5', b'', b'', 10**9)",
    "what swallows every error": "print('busy', flush=True) or swallow()",
}
SWALLOW = """
import hashlib, time
from kalscope.common import stopping
stopping.MAX_STOP_S = 0.1
import kalscope.{module} as module
def swallow():
    while True:
        try:
            time.sleep(60)
        except BaseException:
            pass
module.{name} = lambda *_, **__: {busy}
"""
COMMANDS = {
    "tune demo": ("catalogue", "open_source"),
    "filter run.csv -o out.csv": ("sources.reading.text_file", "_open_raw"),  # has a temporary folder
    "export none.toml --to c -o out": ("tuning.file", "load_tuning"),
    "report demo --config none.toml -o out.html": ("tuning.file", "load_tuning"),
    "reproduce -o .": ("papers.reproduction", "reproduce"),
    "open demo --no-browser --port 0": ("catalogue", "open_source"),
}
"""Commands, and what in them is replaced by something that goes on for ever."""


@pytest.mark.parametrize(
    ("command", "busy", "by"),
    [(command, *how) for command, how in zip(cycle(COMMANDS), product(BUSY, SIGNALS), strict=False)],
    ids=lambda one: one.replace(" ", "-"),
)
def test_a_command_ends_whatever_it_does(command, busy, by, tmp_path):
    """Every way to be busy with every signal."""
    module, name = COMMANDS[command]
    change = SWALLOW.format(module=module, name=name, busy=BUSY[busy])
    with start(tmp_path, *command.split(), source=None, change=change) as program:
        assert next_line(program) == "busy\n"
        assert told_three_times(program, SIGNALS[by]) == (128 + SIGNALS[by], "", said(by))
    assert left_in(tmp_path) == set()


@pytest.mark.parametrize("flood", ["lines", "a line without end"])
def test_a_dashboard_with_a_board_that_floods_ends(flood, tmp_path):
    with Flood(FLOODS[flood]) as sender:
        port = f"socket://127.0.0.1:{sender.port}"
        with start(tmp_path, "--no-browser", "--port", "0", source=port) as program:
            link_of(program)
            wait_until(lambda: sender.sent > TAKEN, "its lines")
            assert told_three_times(program, signal.SIGTERM) == (0, "", "")


@pytest.mark.parametrize(("number", "name"), [(0, "stdin"), (1, "stdout"), (2, "stderr")])
def test_a_standard_stream_that_is_closed_is_no_mistake(number, name, tmp_path):
    change = f"import os; os.close({number}); sys.{name} = None"
    with start(tmp_path, "filter", "demo", "-o", "out.csv", source=None, change=change) as program:
        out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, out) == (0, ""), err
    assert "note: " in err or name == "stderr"
    assert (tmp_path / "out.csv").read_bytes().startswith(b"time")


# --- a dashboard that records a board: the file is finished before anything else ------------------------


PATIENT = f"from kalscope_app import open_command\nopen_command.MAX_RECORDING_S = {PATIENCE}\n"
"""A busy machine may take long to finish a recording."""


def numbered():
    """`number,half of it`, without end."""
    return (f"{number},{number / 2:.1f}\n" for number in count())


def start_recording(guest, folder):
    """Press Record, and wait for rows in the file."""
    guest.read_until(lambda: "Record" in labels(guest))
    guest.set(guest.find("Record"), True)
    guest.read_until(lambda: "Recording to" in "".join(guest.notices))
    file = folder / "recording.csv"
    guest.read_until(lambda: file.read_text().count("\n") >= 20)  # the board's values come as frames
    return file


def assert_finished(file):
    """Whole, consecutive rows and the account of them as the last line."""
    *lines, last = file.read_text().splitlines()
    rows = [line for line in lines if re.match(r"-?[0-9.]+,", line)]
    numbers = [int(float(row.split(",")[1])) for row in rows]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert last.startswith("# end: ")
    assert f"{len(rows)} written" in last


@pytest.mark.parametrize("by", SIGNALS.values(), ids=SIGNALS)
def test_a_recording_is_finished_and_nothing_is_left_behind(tmp_path, by):
    with line_sender(lines=numbered) as board, running(tmp_path, source=board, change=PATIENT) as (program, url):
        port = port_of(url)
        with Guest(port, token_of(url)) as guest:
            file = start_recording(guest, tmp_path)
            children = Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text()
            code, out, err = end(program, by)
        assert (code, out, err, children) == (0, "", "", "")
        assert_finished(file)
        assert is_free(port)
        assert os.listdir(tmp_path / "tmp") == []


FOR_EVER = 10 * PATIENCE
"""Seconds; `end` fails where the program has not ended within PATIENCE."""

SLOW_FRAMES = f"""
import time
from kalscope_app.engine.engine import Engine
Engine.stop = lambda self: time.sleep({FOR_EVER})
"""

SWALLOWING = f"""
import pathlib, time
from kalscope.sources.port.serial_port import SocketPort
openings, connect = [], SocketPort.__init__
def slow(*arguments):
    openings.append(1)
    if len(openings) > 1:
        pathlib.Path("connecting").touch()
        time.sleep({FOR_EVER})
    return connect(*arguments)
SocketPort.__init__ = slow
"""
"""A network that swallows what is sent: to connect again takes longer than the program has to end."""


@pytest.mark.parametrize("change", [SLOW_FRAMES, SWALLOWING], ids=["slow frames", "a board that does not answer"])
def test_a_recording_is_finished_although_something_takes_for_ever(tmp_path, change):
    with ExitStack() as plugged, ExitStack() as used:
        board = plugged.enter_context(line_sender(lines=numbered))
        program, url = used.enter_context(running(tmp_path, source=board, change=PATIENT + change))
        guest = used.enter_context(Guest(port_of(url), token_of(url)))
        file = start_recording(guest, tmp_path)
        if change is SWALLOWING:
            plugged.close()
            guest.read_until(lambda: "disconnected" in "".join(guest.markdown.values()))
            wait_until((tmp_path / "connecting").exists, "an attempt to connect again")
        assert end(program)[0] == 0
        assert_finished(file)
