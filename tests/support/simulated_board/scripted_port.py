"""A port that gives what a test tells it to, and an endpoint that hands out such ports."""

import time

from kalscope.errors import BadDevice
from kalscope.sources.port.transport import Endpoint, OpenPort


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

    def waiting(self):
        return 0

    def write(self, data):
        self.sent += data

    def close(self):
        self.closed = True


class Scripted(Endpoint):
    """Opens one port after the other, then none."""

    def __init__(self, *ports):
        self.device, self.ports = "x", list(ports)

    def open(self, _is_ended):
        if not self.ports:
            raise BadDevice("port must be plugged in (got nothing)")
        return self.ports.pop(0)
