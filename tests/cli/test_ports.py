"""`kalscope ports`."""

import json

import pytest

from kalscope.cli import app as cli
from kalscope.cli.board import NONE_FOUND, ports_text
from kalscope.sources.port.serial_port import PortInfo

PORTS = (
    PortInfo("/dev/ttyS0", "", ""),
    PortInfo("/dev/ttyACM0", "Arduino\nUno\x1b[2J", "7533", (0x2341, 0x43)),
)


def test_ports_are_a_table_that_ends_with_the_command_for_the_board():
    table = ports_text(PORTS).splitlines()
    assert table[0].split("  ")[0] == "device"
    assert table[2].split() == ["/dev/ttyACM0", "Arduino", "Uno", "[2J", "7533"]
    assert table[-1].endswith("kalscope open serial:/dev/ttyACM0@115200")
    assert all(line.isprintable() for line in table)


@pytest.mark.parametrize("ports", [(), PORTS])
def test_json_holds_what_the_table_shows(monkeypatch, capsys, ports):
    monkeypatch.setattr("kalscope.cli.board.list_ports", lambda: ports)
    assert cli.run(["ports", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["device"], row["serial_number"]) for row in rows] == [(p.device, p.serial_number) for p in ports]
    assert cli.run(["ports"]) == 0
    assert capsys.readouterr().out == (ports_text(ports) if ports else NONE_FOUND) + "\n"
