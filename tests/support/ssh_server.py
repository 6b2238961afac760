"""A real sshd on loopback, with keys and a folder of its own, and an `ssh` that knows it under several names."""

import os
import shutil
import signal
import socket
import subprocess
from contextlib import contextmanager, suppress
from pathlib import Path

from program import free_port
from required import not_here
from waiting import wait_until

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


class SshServer:
    """A running sshd; `bin` is to stand first in PATH."""

    def __init__(self, folder):
        self.folder, self.bin = Path(folder), Path(folder) / "bin"
        for name in ("host_key", "other_key", "key", "bare_key", "noisy_key"):
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self.folder / name)]
            subprocess.run(command, check=True)
        self.port = free_port()
        self._write("authorized_keys", self._public("key") + self._forced())
        self._write("known_hosts", f"pi {self._public('host_key')}")
        places = {"folder": self.folder, "port": self.port}
        self._write("ssh_config", CLIENT.format(**places))
        self._write("sshd_config", SERVER.format(**places))
        self.bin.mkdir()
        wrapper = self.bin / "ssh"
        wrapper.write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {self.folder}/ssh_config "$@"\n')
        wrapper.chmod(0o755)
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)  # sshd of root insists on it
        command = [SSHD, "-D", "-e", "-f", str(self.folder / "sshd_config")]
        self._log = (self.folder / "log").open("wb")
        self.process = subprocess.Popen(command, stderr=self._log)
        wait_until(self._answers, "an sshd that answers", pause=0.02)

    def _public(self, name):
        return (self.folder / f"{name}.pub").read_text()

    def _forced(self):
        greeting = r'command="echo Welcome; printf \"no end of line\"; eval \"$SSH_ORIGINAL_COMMAND\"" '
        return f'command="nothing-of-this-name" {self._public("bare_key")}{greeting}{self._public("noisy_key")}'

    def _write(self, name, text):
        path = self.folder / name
        path.write_text(text)
        path.chmod(0o600)

    def _answers(self):
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1):
            return True
        return False

    def cut(self):
        """End every connection, as a router that is switched off does."""
        for pid in descendants(self.process.pid):
            if Path(f"/proc/{pid}/comm").read_text().startswith("sshd"):
                os.kill(pid, signal.SIGKILL)

    def close(self):
        for pid in (*descendants(self.process.pid), self.process.pid):
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
        self._log.close()


def descendants(parent):
    """The processes that a process has started, and those that they have."""
    found = []
    for entry in os.listdir("/proc"):
        with suppress(OSError, ValueError):
            if int(Path(f"/proc/{entry}/stat").read_text().rsplit(")", 1)[1].split()[1]) == parent:
                found += [int(entry), *descendants(int(entry))]
    return found


@contextmanager
def ssh_server(folder):
    """A server for the length of a block; the test is skipped where there is no sshd."""
    if not (Path(SSHD).exists() and shutil.which("ssh")):
        not_here("there is no OpenSSH server")
    server = SshServer(folder)
    try:
        yield server
    finally:
        server.close()
