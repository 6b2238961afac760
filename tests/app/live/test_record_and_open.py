"""Connect, tune, record, stop, open the recording: as a browser does it, with a board behind a socket."""

from __future__ import annotations

import re
import socket
from itertools import count

from line_sender import line_sender
from program import labels, port_of, running, token_of
from wire import Guest


def light():
    """The lines of one channel."""
    return (f"light:{500 + n * n % 17}\n" for n in count(1))


def test_after_stop_a_button_opens_the_recording_and_what_was_tuned_stays(tmp_path):
    with (
        running(tmp_path) as (_program, url),
        Guest(port_of(url), token_of(url)) as guest,
        line_sender(200.0, light) as address,
    ):

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
        guest.set(guest.find("process noise q"), "7")
        guest.set(guest.find("Stop recording"), True)
        says("Recorded mine.csv: ")
        guest.set(guest.find("Open the recording"), True)
        says("Filters and pins of channels of the same name and unit stay")
        says("**mine\\.csv**")


def test_before_the_first_sample_no_text_counts_the_rows_of_the_placeholder(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        source = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with running(tmp_path, source=source) as (_, url), Guest(port_of(url), token_of(url)) as guest:
            for text in ("Waiting for the first 10 samples", "**connected**", "a comparison needs 16"):
                guest.read_until(lambda text=text: text in "".join(guest.markdown.values()))
            assert re.findall(r"\b2 \w*(?:rows|samples)", "".join(guest.markdown.values())) == []
