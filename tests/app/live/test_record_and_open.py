"""Connect, tune, record, stop, open the recording: as a browser does it, with a board behind a socket."""

from __future__ import annotations

import socket
import threading
from contextlib import contextmanager, suppress

from program import labels, port_of, running, token_of
from waiting import PATIENCE
from wire import Guest


@contextmanager
def board():
    """The address of a board that sends one channel at about 200 Hz."""
    over = threading.Event()

    def send(listener):
        with suppress(OSError):
            other, _ = listener.accept()
            with other:
                other.settimeout(10.0)
                n = 0
                while not over.wait(0.005):
                    n += 1
                    other.sendall(b"light:%d\n" % (500 + n * n % 17))

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(PATIENCE)
        thread = threading.Thread(target=send, args=(listener,))
        thread.start()
        try:
            yield f"socket://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            over.set()
            thread.join()


def test_after_stop_a_button_opens_the_recording_and_what_was_tuned_stays(tmp_path):
    with running(tmp_path) as (_program, url), Guest(port_of(url), token_of(url)) as guest, board() as address:

        def says(text):
            guest.read_until(lambda: text in "".join((*guest.markdown.values(), *guest.notices)))

        guest.read_until(lambda: "Connect" in labels(guest))
        guest.set(guest.find("port"), "Other address …")
        guest.set(guest.find("address"), address)
        guest.set(guest.find("Connect"), True)
        says("**connected**")
        guest.read_until(lambda: "light" in guest.options[guest.find("channel")])
        guest.set(guest.find("record to"), "mine.csv")
        guest.set(guest.find("Record"), True)
        says("recording to **mine\\.csv**")
        guest.set(guest.find("Apply preset"), True)
        guest.set(guest.find("Stop recording"), True)
        says("Recorded mine.csv")
        guest.set(guest.find("Open the recording"), True)
        says("Kept for light: q, r, p0, x0, momentum and gate")
        says("**mine\\.csv**")
