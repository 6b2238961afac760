"""Errors of ssh and of the other machine, each as one sentence that says what to do."""

from __future__ import annotations

import re
from typing import Protocol

from kalscope.sources.port.transports.words import short

_CONNECTION_FAILED = 255
"""Exit status of ssh where it is the connection that failed."""
_NOT_FOUND = 127


class Address(Protocol):
    """The parts of an address that messages name."""

    host: str
    device: str

    @property
    def login(self) -> str:
        """What is typed after ssh."""
        ...


def failure_words(address: Address, status: int, said: str) -> str:
    """Why ssh ended.

    Args:
        address: The address that was to be opened.
        status: Its exit status.
        said: What it wrote to standard error.
    """
    host, login = address.host, address.login
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    last = short(lines[-1]) if lines else f"status {status}"
    if status != _CONNECTION_FAILED:
        if status == _NOT_FOUND or re.search("python3: (command )?not found", said, re.IGNORECASE):
            return f"{host} has no python3, which reads the port there: sudo apt install python3"
        gone = f"{address.device} is gone: the board was unplugged, or the file was replaced"
        return f"ssh to {host} ended ({last})" if status else gone
    known = {
        "IDENTIFICATION HAS CHANGED": f"{host} shows another host key than the one that ssh knows: if it was set up"
        f" again, ssh-keygen -R {host}, else somebody may be listening",
        "Host key verification failed": f"the host key of {host} is not known here: run ssh {login} once and"
        " compare its fingerprint",
        "Permission denied": f"{host} accepts none of your keys, and a password cannot be asked for here: run"
        f" ssh-copy-id {login} once",
    }
    silent = ("ssh: connect to", "Could not resolve", "banner exchange", "kex_exchange")
    otherwise = f"{host} does not answer ({last})" if any(words in said for words in silent) else ""
    found = (words for mark, words in known.items() if mark in said)
    return next(found, otherwise or f"the connection to {host} was cut ({last})")


def refusal_words(why: str, path: str, host: str) -> str:
    """Why the other machine did not open a path; `why` as `growing_file.Unusable` has it."""
    words = {
        "missing": f"there is no {path} on {host}",
        "denied": f"no permission to open {path} on {host} (for a port, there: sudo usermod -aG dialout $USER)",
        "busy": f"{path} is in use by another program on {host}",
        "no port": f"{path} on {host} is not a serial port",
        "irregular": f"{path} on {host} is neither a serial port nor a file",
    }
    return words.get(why, f"{path} cannot be opened on {host} ({short(why)})")
