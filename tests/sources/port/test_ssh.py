"""ssh:// addresses against a real sshd: nothing lost, every failure one sentence, nothing left behind."""

import ast
import os
import shutil
import socket
import subprocess
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest
from tests.sources.scripted_port import kept, lines
from tests.support.program import free_port
from tests.support.required import not_here
from tests.support.waiting import wait_until

from kalscope.errors import BadDevice
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port import far_side
from kalscope.sources.port.registry import port_of
from kalscope.sources.port.ssh import SshPort, ssh_arguments

SSHD = shutil.which("sshd") or "/usr/sbin/sshd"

SERVER = """
Port {port}
ListenAddress 127.0.0.1
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/authorized_keys
PidFile none
StrictModes no
UsePAM no
PermitRootLogin yes
PasswordAuthentication yes
LoginGraceTime 20
MaxStartups 100
"""

CLIENT = """
Host stranger
  HostKeyAlias stranger
Host closed
  Port 1
Host bare noisy
  IdentityFile {folder}/%n_key
Host locked
  IdentityFile {folder}/other_key
Host * !bare !noisy !locked
  IdentityFile {folder}/key
Host *
  HostName 127.0.0.1
  Port {port}
  IdentitiesOnly yes
  UserKnownHostsFile {folder}/known_hosts
  GlobalKnownHostsFile none
  HostKeyAlias pi
"""
"""`locked` has a key that opens nothing and would have to type a password, `bare` has no Python, `noisy` greets at
every login."""


GREETING = r'command="echo Welcome; printf \"no end of line\"; eval \"$SSH_ORIGINAL_COMMAND\"" '


class SshServer:
    """A running sshd; `bin` is to stand first in PATH."""

    def __init__(self, folder):
        self.bin, public, places = folder / "bin", {}, {"folder": folder, "port": free_port()}
        self.address = ("127.0.0.1", places["port"])
        for name in ("host_key", "other_key", "key", "bare_key", "noisy_key"):
            subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / name], check=True)
            public[name] = (folder / f"{name}.pub").read_text()
        bare = f'command="nothing-of-this-name" {public["bare_key"]}'
        self.bin.mkdir()
        for name, text, mode in (
            ("authorized_keys", public["key"] + bare + GREETING + public["noisy_key"], 0o600),
            ("known_hosts", f"pi {public['host_key']}", 0o600),
            ("ssh_config", CLIENT.format(**places), 0o600),
            ("sshd_config", SERVER.format(**places), 0o600),
            ("bin/ssh", f'#!/bin/sh\nexec {shutil.which("ssh")} -F {folder}/ssh_config "$@"\n', 0o755),
        ):
            (folder / name).write_text(text)
            (folder / name).chmod(mode)
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)  # sshd of root insists on it
        command = [SSHD, "-D", "-e", "-f", folder / "sshd_config"]
        self.process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        wait_until(self._answers, "an sshd that answers", pause=0.02)

    def _answers(self):
        with suppress(OSError), socket.create_connection(self.address, 1):
            return True
        return False

    def cut(self):
        """End every connection, as a router that is switched off does."""
        for process in self.descendants():
            if process.name().startswith("sshd"):
                process.kill()

    def close(self):
        for process in (*self.descendants(), self.process):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self.process.wait()

    def descendants(self):
        """The processes that the server has started, and those that they have."""
        return psutil.Process(self.process.pid).children(recursive=True)


pytestmark = pytest.mark.usefixtures("no_thread_left")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    if not (Path(SSHD).exists() and shutil.which("ssh")):
        not_here("there is no OpenSSH server")
    server = SshServer(tmp_path_factory.mktemp("ssh"))
    yield server
    server.close()


@pytest.fixture
def pi(server, monkeypatch, wait_for):
    """The server, as the `ssh` of this computer knows it; at the end nothing runs there any more."""
    monkeypatch.setenv("PATH", f"{server.bin}:/usr/bin:/bin")
    yield server
    wait_for(lambda: not server.descendants())


def values(live):
    return live.snapshot().recording.values[:, 0]


def test_a_port_of_another_machine_is_a_port_and_a_cut_connection_a_gap(pi, board, wait_for, tmp_path):
    with LiveSource(port_of(f"ssh://pi{board.link}@115200", reset=False)) as live:
        wait_for(lambda: live.status().word == "connected")
        live.record(tmp_path / "run.csv")
        board.say(b"x\nheat,light\n" + lines(0, 3000))
        wait_for(lambda: kept(live) == 3000)
        np.testing.assert_array_equal(values(live), np.arange(3000))
        threading.Thread(target=lambda: (board.heard(), board.say(b"# q=0.01\r\n"))).start()
        assert live.send("q0.01", timeout=100) == ("# q=0.01",)
        pi.cut()
        wait_for(lambda: live.status().word != "connected")
        assert "there is no connection to pi" in live.status().hint
        wait_for(lambda: live.status().word == "connected")
        board.say(b"x\n" + lines(3000, 3100))
        wait_for(lambda: kept(live) == 3101)
        status = live.status()
        assert (status.received, status.accepted, status.rejected, status.reconnects) == (3104, 3100, 0, 1)
    assert (tmp_path / "run.csv").read_text().count("# gap unplug") == 1


def test_a_second_reader_and_a_baud_rate_that_stty_there_lacks_are_refused(pi, board):
    with pytest.raises(BadDevice, match=r"must be a serial port: stty: invalid argument .123457"):
        SshPort(port_of(f"ssh://pi{board.link}@123457"), bool, None)
    with LiveSource(f"ssh://pi{board.link}") as live:
        live.close()
        live.start(require=True)
        with pytest.raises(BadDevice, match=r"pi cannot read it there: .* is in use by another program"):
            SshPort(port_of(f"ssh://pi{board.link}@9600"), bool, None)


@pytest.mark.parametrize(("address", "words"), [
    ("ssh://stranger/dev/null", r"to stranger \(Host key verification failed.\): does .* accept the host key"),
    ("ssh://closed/dev/null", r"there is no connection to closed \(.*refused\)"),
    ("ssh://locked/dev/null", r"locked \(.*Permission denied.*by ssh-copy-id locked: no password"),
    ("ssh://nobody.invalid@pi/dev/null", "ssh-copy-id nobody.invalid@pi"),
    ("ssh://bare/dev/null", "bare cannot read it there: .*command not found .*python3"),
    ("ssh://noisy/dev/null", "noisy cannot read it there: /dev/null: must be a serial port: stty: "),
    ("ssh://pi/dev/ttyNONE", "pi cannot read it there: /dev/ttyNONE: No such file"),
    ("ssh://pi/~/nothing%20here", "pi cannot read it there: ~/nothing here: No such file"),
    ("ssh://pi/tmp", "pi cannot read it there: /tmp: must be a file or a serial port"),
])  # fmt: skip
def test_what_does_not_open_is_one_sentence(pi, address, words):
    with pytest.raises(BadDevice, match=words):
        SshPort(port_of(address), bool, None)


def test_without_ssh_there_is_one_sentence_too(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadDevice, match="needs the program ssh, which is not installed"):
        SshPort(port_of("ssh://pi/dev/ttyACM0"), bool, None)


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


def test_the_program_for_the_other_machine_is_python_3_7_and_gets_host_and_user_as_data():
    ast.parse(Path(far_side.__file__).read_text(encoding="utf-8"), feature_version=(3, 7))
    assert ssh_arguments("ssh", "SSH://me@[::1]:22/dev/x")[-7:-1] == ["-l", "me", "-p", "22", "--", "::1"]
