"""A text as a recording; a fake board on a pseudo-terminal that is plugged in, pulled out and plugged in again."""

import os
import threading

import pytest
from tests.support.waiting import wait_until as wait_for

from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.live.source import LiveSource
from kalscope.sources.reading.recording_file import read_recording


@pytest.fixture
def read(tmp_path):
    """Reads a text, or bytes, as a file; further arguments are those of ReadOptions."""

    def read_content(content, name="log.csv", *, encoding="utf-8", period=None, **options):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
        return read_recording(path, ReadOptions(**options), sample_period=period)

    return read_content


class FakeBoard:
    """A board behind a symlink of the same name each time it is plugged in; it goes when the board is pulled out.

    If it stayed, a reader that waits would open the terminal of another test, which gets the same number.
    """

    def __init__(self, link):
        self.link, self.master = str(link), -1
        self.plug()

    def plug(self):
        """Plug in: the link leads to a new terminal."""
        import tty

        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.symlink(os.ttyname(self.slave), self.link)

    def say(self, data):
        """Send bytes; waits while the buffer of the terminal is full."""
        while data:
            data = data[os.write(self.master, data) :]

    def heard(self):
        """Wait until a line was sent to the board."""
        while not os.read(self.master, 4096).endswith(b"\n"):
            pass

    def unplug(self):
        """Pull the cable."""
        if self.master >= 0:
            os.unlink(self.link)
            os.close(self.slave)
            os.close(self.master)
            self.master = -1


@pytest.fixture
def board(tmp_path):
    board = FakeBoard(tmp_path / "ttyBOARD")
    yield board
    board.unplug()


@pytest.fixture
def live(board):
    live = LiveSource(board.link)
    live.start(require=True)
    yield live
    live.close()


@pytest.fixture(name="wait_for")
def wait_for_fixture():
    return wait_for


@pytest.fixture
def no_thread_left():
    """All threads that a test started have ended when it is over."""
    before = set(threading.enumerate())
    yield
    wait_for(lambda: set(threading.enumerate()) <= before, "the end of all threads")
