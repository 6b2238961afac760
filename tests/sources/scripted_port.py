"""A port that gives what a test tells it to, sources that read such ports, and what a live source has kept."""

import time

from kalscope.errors import BadDevice
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.reader import OpenPort, PortReader
from kalscope.sources.port.registry import PortSpec


class ScriptedPort(OpenPort):
    """Gives each item of a script: bytes, or an error that is raised. Then nothing."""

    def __init__(self, script, starts="inside a line", keeps=False):
        self.script, self.starts, self.keeps = list(script), starts, keeps
        self.closed, self.sent = False, b""

    def fetch(self):
        if not self.script:
            time.sleep(0.005)
            return b""
        item = self.script.pop(0)
        if isinstance(item, BaseException):
            raise item
        return item

    def write(self, data):
        self.sent += data

    def close(self):
        self.closed = True


def scripted(*ports):
    """Opens one port after the other, then none."""
    rest = list(ports)

    def opener(_spec, _is_ended, _last):
        if not rest:
            raise BadDevice("port must be plugged in (got nothing)")
        return rest.pop(0)

    return opener


def source_of(*ports):
    """A live source that opens one scripted port after the other."""
    return LiveSource("x", reader=PortReader(PortSpec("x"), opener=scripted(*ports)))


def lines(begin, end):
    """Rows of a board: two channels of whole numbers."""
    return b"".join(b"%d,%d\r\n" % (i, -i) for i in range(begin, end))


def kept(live):
    """Samples that a live source has kept since its start."""
    snapshot = live.snapshot()
    return 0 if snapshot is None else snapshot.first + len(snapshot.recording)
