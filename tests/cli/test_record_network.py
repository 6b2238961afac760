"""`kalscope record` of what comes over the network: as any board's recording, and it opens again."""

from __future__ import annotations

import signal
import socket
import time

import numpy as np
from tests.support.program import command, free_port
from tests.support.waiting import PATIENCE, wait_until

from kalscope.sources.reading.recording_file import read_recording


def test_datagrams_are_recorded_and_the_recording_opens_again(tmp_path):
    path, port = tmp_path / "run.csv", free_port(socket.SOCK_DGRAM)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board,
        command("record", f"udp://:{port}", "-o", path) as process,
    ):
        wait_until(lambda: path.exists() or process.returncode is not None, "the recording")
        for i in range(500):
            board.sendto(b"temp:%d:%d|g\nhum:%d:%d\nstate:ok|t" % (10 * i, i, 10 * i, -i), ("127.0.0.1", port))
            time.sleep(0.001)
        wait_until(lambda: b",-499\n" in path.read_bytes(), "the last line")
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert "received 1000 lines = 1000 written + 0 rejected + 0 dropped; 500 others" in out
    assert f"# source: udp://:{port}" in path.read_text()
    again = read_recording(path)
    for name, sign in (("temp", 1), ("hum", -1)):
        values = again.channel(name)
        np.testing.assert_array_equal(values[np.isfinite(values)], sign * np.arange(500))
