"""No control character of a name from outside reaches the terminal."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope.cli.app import run
from kalscope.cli.board.ports import ports_text
from kalscope.common.text import CONTROL
from kalscope.sources.port.port_spec import PortInfo

HOSTILE = "a\x1b]52;c;ZXZpbA==\x07\x1b[2J\x9b31m\x7f\u202e\u2028b"
"""Sets the clipboard, clears the screen, changes the colour, turns the direction, ends a line."""

COMMANDS = (
    ("tune", "{log}"),
    ("tune", "{log}", "--all", "--details"),
    ("tune", "{log}", "--json"),
    ("tune", "{log}", "-o", "{tuning}"),
    ("filter", "{log}", "--config", "{tuning}", "--report"),
    ("filter", "{log}", "--config", "{tuning}", "--channel", HOSTILE),
    ("export", "{tuning}", "--to", "c", "-o", "{log}.c"),
    ("export", "{tuning}", "--to", HOSTILE),
    ("report", "{log}", "--config", "{tuning}", "-o", "{log}.html"),
    ("tune", "{log}" + HOSTILE),
    ("ports", HOSTILE),
)


def test_names_of_files_channels_and_options_are_plain(tmp_path, capsys):
    log = tmp_path / f"{HOSTILE}.csv"
    values = np.cumsum(np.random.default_rng(1).normal(size=200)).tolist()
    rows = "\n".join(f"{i},{value}" for i, value in enumerate(values))
    log.write_text(f"time (s),{HOSTILE} ({HOSTILE})\n{rows}\n", encoding="utf-8")
    said = {}
    for command in COMMANDS:
        run([part.format(log=log, tuning=tmp_path / "tuning.toml") for part in command])
        said[command] = "".join(capsys.readouterr())
    assert sum("]52;c;ZXZpbA==" in text for text in said.values()) > 6
    assert [command for command, text in said.items() if CONTROL.search(text)] == []


def test_what_a_usb_device_says_of_itself_is_plain():
    port = PortInfo("/dev/ttyACM0", HOSTILE, HOSTILE)
    assert not CONTROL.search(ports_text((port,)))


@pytest.mark.parametrize("text", ["1\u202f469 °C²", "a\tb\nc", "−8 dB µ"])
def test_units_thin_spaces_tabs_and_lines_stay(text):
    assert not CONTROL.search(text)
