"""ssh:// addresses against a real sshd: nothing lost, every failure one sentence, nothing left behind."""

import ast
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from each import each
from ssh_server import descendants, ssh_server

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port import far_side, growing_file
from kalscope.sources.port.registry import port_of
from kalscope.sources.port.ssh import SshEndpoint, refusal_words

pytestmark = pytest.mark.usefixtures("no_thread_left")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with ssh_server(tmp_path_factory.mktemp("ssh")) as server:
        yield server


@pytest.fixture
def pi(server, monkeypatch, wait_for):
    """The server, as the `ssh` of this computer knows it; at the end nothing runs there any more."""
    monkeypatch.setenv("PATH", f"{server.bin}:/usr/bin:/bin")
    yield server
    wait_for(lambda: not descendants(server.process.pid))


def lines(begin, end):
    return b"".join(b"%d,%d\r\n" % (i, -i) for i in range(begin, end))


def kept(live):
    snapshot = live.snapshot()
    return 0 if snapshot is None else snapshot.first + len(snapshot.recording)


def values(live):
    return live.snapshot().recording.values[:, 0]


def test_a_port_of_another_machine_is_a_port(pi, board, wait_for):
    with LiveSource(port_of(f"ssh://pi{board.link}@250000", reset=False)) as live:
        wait_for(lambda: live.status().word == "connected")
        board.say(b"x\nheat,light\n")
        start = time.monotonic()
        for first in range(0, 3000, 10):
            board.say(lines(first, first + 10))
            time.sleep(max(0.0, start + (first + 10) / 1000 - time.monotonic()))
        wait_for(lambda: kept(live) == 3000)
        np.testing.assert_array_equal(values(live), np.arange(3000))
        status = live.status()
        assert (status.received, status.accepted, status.rejected, status.dropped) == (3002, 3000, 0, 2)
        threading.Thread(target=lambda: (board.heard(), board.say(b"# q=0.01\r\n"))).start()
        assert live.send("q0.01", timeout=100) == ("# q=0.01",)


def test_a_cut_connection_is_a_gap_and_comes_back(pi, board, tmp_path, wait_for):
    with LiveSource(f"ssh://pi{board.link}") as live:
        wait_for(lambda: live.status().word == "connected")
        live.record(tmp_path / "run.csv")
        board.say(b"x\n" + lines(0, 100))
        wait_for(lambda: kept(live) == 100)
        pi.cut()
        wait_for(lambda: live.status().word != "connected")
        assert "the connection to pi was cut" in live.status().hint
        wait_for(lambda: live.status().word == "connected")
        board.say(b"x\n" + lines(100, 200))
        wait_for(lambda: kept(live) == 201)
        status = live.status()
        assert (status.reconnects, status.accepted) == (1, 200)
    text = (tmp_path / "run.csv").read_text()
    assert text.count("# gap unplug") == 1
    assert text.count("\n") == 5 + 200 + 2


def test_a_board_that_is_pulled_out_there_is_waited_for(pi, board, wait_for):
    with LiveSource(f"ssh://pi{board.link}") as live:
        wait_for(lambda: live.status().word == "connected")
        board.unplug()
        wait_for(lambda: "board was unplugged" in live.status().hint or "there is no" in live.status().hint)
        wait_for(lambda: "there is no" in live.status().hint)
        board.plug()
        wait_for(lambda: live.status().word == "connected")


def test_a_second_reader_is_refused(pi, board):
    with LiveSource(f"ssh://pi{board.link}") as live:
        live.close()
        live.start(require=True)
        with pytest.raises(BadDevice, match="in use by another program on pi"):
            SshEndpoint(f"ssh://pi{board.link}", 9600, True).open(bool)


@each(
    ("address", "words"),
    [
        ("ssh://stranger/dev/null", "the host key of stranger is not known here: run ssh stranger once"),
        ("ssh://impostor/dev/null", "impostor shows another host key than the one that ssh knows"),
        ("ssh://closed/dev/null", r"closed does not answer \(.*refused\)"),
        ("ssh://locked/dev/null", "locked accepts none of your keys, and a password cannot .* ssh-copy-id locked"),
        ("ssh://nobody.invalid@pi/dev/null", "ssh-copy-id nobody.invalid@pi once"),
        ("ssh://bare/dev/null", "bare has no python3"),
        ("ssh://noisy/dev/null", "/dev/null on noisy is not a serial port"),
        ("ssh://pi/dev/ttyNONE", "there is no /dev/ttyNONE on pi"),
        ("ssh://pi/~/nothing%20here", "there is no ~/nothing here on pi"),
        ("ssh://pi/tmp", "/tmp on pi is neither a serial port nor a file"),
    ],
)
def test_what_does_not_open_is_one_sentence(pi, address, words):
    port = port_of(address)
    with pytest.raises(BadDevice, match=words):
        port.transport.endpoint(port.url, port.baud, port.reset).open(bool)


def test_without_ssh_there_is_one_sentence_too(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadDevice, match="needs the program ssh, which is not installed"):
        SshEndpoint("ssh://pi/dev/ttyACM0", 9600, True).open(bool)


def test_connecting_is_given_up_when_nobody_wants_it(pi, board):
    with pytest.raises(BadDevice, match="was closed before it had opened"):
        SshEndpoint(f"ssh://pi{board.link}", 9600, True).open(lambda: True)


def test_each_refusal_has_its_words():
    said = {why: refusal_words(why, "/x", "pi") for why in ("missing", "denied", "busy", "no port", "irregular")}
    assert len({*said.values(), refusal_words("else", "/x", "pi")}) == 6
    assert "usermod" in said["denied"]


@each(
    "text",
    [
        "ssh://",
        "ssh://pi",
        "ssh://user@pi",
        "ssh:///dev/ttyACM0",
        "ssh://-oProxyCommand=touch x/dev/ttyACM0",
        "ssh://-oProxyCommand=x@pi/dev/ttyACM0",
        "ssh://pi;touch x/dev/ttyACM0",
        "ssh://$(touch x)/dev/ttyACM0",
        "ssh://a@b@pi/dev/ttyACM0",
        "ssh://pi:0/dev/ttyACM0",
        "ssh://pi:70000/dev/ttyACM0",
        "ssh://user:secret@pi/dev/ttyACM0",
        "ssh://pi/dev/tty%0aACM0",
        "ssh://pi/dev/ttyACM0@fast",
    ],
)
def test_an_address_that_is_no_address_never_reaches_ssh(text):
    with pytest.raises(BadSetting, match=r"ssh address|an address must (be|hold no password)|baud rate"):
        port_of(text)


@each(
    ("text", "login"),
    [
        ("ssh://pi/dev/x", "pi"),
        ("ssh://me@pi:2222/dev/x@9600", "-p 2222 me@pi"),
        ("SSH://me@[::1]:22/dev/x", "-p 22 me@::1"),
    ],
)
def test_an_address_names_user_host_and_port(text, login):
    spec = port_of(text)
    endpoint = SshEndpoint(spec.url, spec.baud, spec.reset)
    assert endpoint.login == login
    assert endpoint.arguments("ssh")[-3:-1] == ["--", endpoint.host]
    assert port_of(spec.text) == spec


def test_a_path_is_never_run(pi, tmp_path, wait_for):
    name = "a'b\"c $(touch run) `touch run` ; touch run & \\ %25 #é.csv"
    (tmp_path / name.replace("%25", "%")).write_text("t [s],heat\n0,1\n0.5,2\n")
    with LiveSource(f"ssh://pi{tmp_path}/{name}") as live:
        wait_for(lambda: kept(live) == 2)
        np.testing.assert_array_equal(values(live), [1, 2])
    assert not (tmp_path / "run").exists()
    assert not (Path.home() / "run").exists()


def test_a_file_of_another_machine_continues_after_a_cut_without_a_gap(pi, tmp_path, wait_for):
    path = tmp_path / "run.csv"
    path.write_text("".join(["t [s],heat\n", *(f"{i / 100},{i}\n" for i in range(5000))]))
    with LiveSource(f"ssh://pi{path}") as live, path.open("a") as file:
        wait_for(lambda: kept(live) == 5000)
        file.write("50,5000\n50.01,50")
        file.flush()
        wait_for(lambda: kept(live) == 5001)
        pi.cut()
        wait_for(lambda: live.status().word != "connected")
        file.write("01\n50.02,5002\n")
        file.flush()
        wait_for(lambda: kept(live) == 5003)
        recording = live.snapshot().recording
        np.testing.assert_array_equal(recording.values[:, 0], np.arange(5003))
        np.testing.assert_allclose(recording.time, np.arange(5003) / 100, atol=1e-9)
        assert recording.sample_period == pytest.approx(0.01)
        status = live.status()
        assert (status.received, status.accepted, status.dropped, status.reconnects) == (5004, 5003, 1, 1)


ODD = ["{", "[1]", '"path"', "{}", '{"position": "1"}', 9000 * "["]


@each("answer", ODD, ids=range(len(ODD)))
def test_an_answer_that_is_none_is_one_sentence(answer, tmp_path, monkeypatch):
    (tmp_path / "answer").write_bytes(far_side.MARK + answer.encode() + b"\n")
    (tmp_path / "ssh").write_text(f"#!/bin/sh\ncat {tmp_path}/answer -\n")
    (tmp_path / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    with pytest.raises(BadDevice, match="pi sends something other than the answer of Python"):
        SshEndpoint("ssh://pi/log.csv", 9600, True).open(lambda: False)


def test_the_place_in_a_file_that_was_replaced_is_known_again(pi, tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(lines(0, 100))
    endpoint = SshEndpoint(f"ssh://pi{path}", 9600, True)
    for written, new in ((b"", lines(0, 100)), (b"1,2\n", b"1,2\n"), (b"1,2\n3,4\n", b"3,4\n")):
        path.write_bytes(written or path.read_bytes())
        port, read = endpoint.open(lambda: False), b""
        while len(read) < len(new):
            read += port.fetch()
        port.close()
        assert read == new


@each("module", [far_side, growing_file])
def test_what_runs_on_an_old_machine_is_python_3_7(module):
    ast.parse(Path(module.__file__).read_text(encoding="utf-8"), feature_version=(3, 7))
