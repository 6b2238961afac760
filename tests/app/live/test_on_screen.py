"""The real program on screen with a board behind a socket: before its first sample, and a demo board that obeys."""

from __future__ import annotations

import re
import socket

from tests.app.wire import Guest
from tests.support.program import command, next_line, port_of, running, token_of


def test_before_the_first_sample_no_text_counts_the_rows_of_the_placeholder(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        source = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with running(tmp_path, source=source) as (_, url), Guest(port_of(url), token_of(url)) as guest:
            for text in ("Waiting for the first 10 samples", "**connected**", "a comparison needs 16"):
                guest.read_until(lambda text=text: text in "".join(guest.markdown.values()))
            assert re.findall(r"\b2 \w*(?:rows|samples)", "".join(guest.markdown.values())) == []


def test_a_demo_board_takes_what_is_sent_and_measures_its_noise(tmp_path):
    source = "synthetic:constant?n=900&sample_period=0.002&sigma=3"
    with command("demo-board", source, "--sketch", cwd=tmp_path) as board:
        address = next_line(board).split()[-1]
        with running(tmp_path, source=address) as (_, url), Guest(port_of(url), token_of(url)) as guest:

            def says(text):
                guest.read_until(lambda: text in "".join((*guest.markdown.values(), *guest.notices)))

            says("**connected**")
            says("the board's filter differs")
            guest.set(guest.find("process noise q"), "0.037")
            guest.set(guest.find("measurement noise r"), "11.3")
            guest.set(guest.find("Send q, r and p0"), True)
            says("The board now uses q = 0.037, r = 11.3, p0 = inf")
            says("**Equal bit for bit** in ")
            guest.set(guest.find("measure for (s)"), "0.5")
            guest.set(guest.find("Let the board measure r"), True)
            says("equal within 0.0010 %")
