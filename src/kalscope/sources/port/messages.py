"""Whole messages as lines: datagrams of udp://, and what a broker of mqtt:// passes on."""

from __future__ import annotations

import os
import re
import socket
import ssl
import time
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.grammar.cells import MISSING, is_number, split_measure
from kalscope.sources.grammar.line_format import find_pairs, split_teleplot
from kalscope.sources.port.reader import CONNECT_TIMEOUT, MAX_READ_BYTES, MQTT_ENV, READ_TIMEOUT, OpenPort, quoted
from kalscope.sources.port.serial_port import host_and_port

if TYPE_CHECKING:
    from kalscope.sources.port.registry import PortSpec

# What whole messages hold, as lines for the line parser. Opens nothing.


_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")


def lines_of(data: bytes) -> bytes:
    r"""The lines of one message, each with its \n; b"" for none. A binary one is one line, to be rejected."""
    if _BINARY.search(data):
        return b"\0" + data[:200].replace(b"\r", b" ").replace(b"\n", b" ") + b"\n"
    lines = re.split(r"[\r\n]+", data.decode("utf-8", "replace"))
    return "".join(f"{_marked(line)}\n" for line in lines if line.strip()).encode()


def _marked(line: str) -> str:
    """A sample of Teleplot with the > that it has on a serial port; senders of datagrams leave it out."""
    marked = ">" + line.lstrip()
    plot = split_teleplot(marked)
    if plot is None or is_number(plot.name):
        return line
    return marked if any(is_number(value) or value.lower() in MISSING for _, value in plot.samples) else line


HOLD_S = 0.5
"""Seconds for which the first variables are held: a board sends all at once."""


class MessagePort(OpenPort):
    """A port of whole messages, gathered as lines.

    The first read waits until each variable of Teleplot has likely come once: a board of six would begin with one,
    then two, then three, and each time the charts would start again, with a new part of the recording.
    """

    starts = "at a line"

    _begun = False
    lines: bytes = b""
    """What was gathered, and not fetched yet."""

    @abstractmethod
    def gather(self) -> None:
        """Wait READ_TIMEOUT for messages; add their lines, up to the first beyond MAX_READ_BYTES."""

    def fetch(self) -> bytes:
        """Lines of the messages that have arrived; see OpenPort."""
        self.gather()
        if self.lines and not self._begun:
            self._begun, end = True, time.monotonic() + HOLD_S
            while self.lines.startswith(b">") and len(self.lines) < MAX_READ_BYTES and time.monotonic() < end:
                self.gather()
        data, self.lines = self.lines, b""
        return data


# Messages of MQTT as lines: the topic names the channel, the payload holds its value. Opens nothing.
#
# One topic alone sends lines as any board does, and a bare number takes the name of its last level. Of several
# topics each value becomes a line of Teleplot, `>barn/temperature:21.5`, so that topics may come and go.


MAX_PAYLOAD = 65_536
"""Bytes of one payload, as of one line: a larger one is a picture or a file."""


def topic_lines(subscribed: str, topic: str, payload: bytes) -> bytes:
    r"""The lines of one message, each with its \n.

    Args:
        subscribed: What is subscribed to: one topic, or several by + and #.
        topic: Its topic.
        payload: What it holds.
    """
    levels, wild = topic.split("/"), [i for i, level in enumerate(subscribed.split("/")) if level in ("+", "#")]
    name = _printable("/".join(levels[wild[0] if wild else -1 :] or levels[-1:])).strip() or "topic"
    if len(payload) > MAX_PAYLOAD:
        return _line(name, f"({len(payload)} bytes: a payload must have at most {MAX_PAYLOAD})")
    if _BINARY.search(payload):
        return lines_of(payload)
    text = " ".join(payload.decode("utf-8", "replace").split())
    values = _values(text)
    if not wild and [of for of, _, _ in values] != [""]:
        return lines_of(payload)
    if not values:
        return _line(name, f"{text}|t")
    return b"".join(_line(name + of, value + (f"§{unit}" if unit else "")) for of, value, unit in values)


def _printable(name: str) -> str:
    """A name without the marks of a line of Teleplot: a MAC address is AA_BB, not AA:BB."""
    return re.sub(r"[:;>|§\x00-\x1f\x7f]", "_", name)[:200]


def _line(name: str, value: str) -> bytes:
    return f">{name}:{value}\n".encode()


def _values(text: str) -> list[tuple[str, str, str]]:
    """(end of the name, number, unit) of each value of a payload: a number, named values, or a list of numbers."""
    if measure := _measure(text):
        return [("", *measure)]
    found, cells = find_pairs(text), re.split(r"[,;\s]+", text.strip("[] "))
    if found is not None:
        pairs = [(f".{label}", value) for label, value in found]
    else:
        pairs = [(f"[{i}]", cell) for i, cell in enumerate(cells)] if all(map(is_number, cells)) else []
    return [(_printable(of), *measure) for of, value in pairs if (measure := _measure(value))]


def _measure(text: str) -> tuple[str, str] | None:
    """A value and its unit; None for any other text."""
    return (text, "") if is_number(text) or text.lower() in MISSING - {""} else split_measure(text)


# mqtt://broker/topic and mqtts://: the messages that a broker passes on, by paho-mqtt.
#
# The reader thread of the port drives the client: it has no thread of its own, and it never reconnects by itself.
# The subscription has quality of service 1: what a sensor publishes so is acknowledged here, and sent again
# where it was lost. A session ends with its connection: what is published while there is none is never delivered.


PORT = 1883
TLS_PORT = 8883
"""Ports of mqtt:// and mqtts:// where the address names none."""
_REFUSED = 128
"""The lowest reason code of MQTT by which a broker refuses."""

_ADDRESS = re.compile(
    r"(mqtts?)://(?:([^@/\s]*)@)?(?:\[([0-9A-Fa-f:.]+)\]|([^/:?@\[\]\s]+))(?::([0-9]{1,5}))?/(.+)",
    re.IGNORECASE | re.DOTALL,
)


def mqtt_parts(address: str) -> re.Match[str]:
    """The parts of an address: scheme, user, host in brackets, host, port and topic.

    Raises:
        BadSetting: it is not mqtt://[user@]broker[:port]/topic, or paho-mqtt is not installed.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or not 1 <= int(match[5] or PORT) <= 65_535:
        raise BadSetting(f"an address must be mqtt://[user@]broker[:port]/topic (got {quoted(address)})")
    try:
        import_module("paho.mqtt.client")
    except ImportError:
        raise BadSetting('mqtt:// needs paho-mqtt: pip install "kalscope[mqtt]" or pip install paho-mqtt') from None
    return match


class _TlsSocket(ssl.SSLSocket):
    """A connection that closes where its handshake fails: paho would leave it open."""

    def do_handshake(self, block: bool = False) -> None:
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise


class MqttPort(MessagePort):
    """A subscription."""

    prefixes = ("mqtt://", "mqtts://")
    check = staticmethod(mqtt_parts)

    def __init__(self, spec: PortSpec, is_ended: Callable[[], bool], _last: OpenPort | None) -> None:
        """Connect and subscribe; see OpenPort."""
        paho: Any = import_module("paho.mqtt.client")
        match = mqtt_parts(spec.url)
        tls, self._host = match[1].lower() == "mqtts", match[3] or match[4]
        port = int(match[5] or (TLS_PORT if tls else PORT))
        self._topic = match[6].replace("%40", "@")  # nothing else is decoded: a % is rare in a topic
        self.when_silent = f"does anything publish on {self._topic}, and may this user read it?"
        self._answer: int | None = None
        """The broker's answer to the connection and the subscription, a reason code: 128 and more refuse."""
        version = paho.CallbackAPIVersion.VERSION2
        self._client: Any = paho.Client(version, protocol=paho.MQTTv311, reconnect_on_failure=False)
        self._client.on_connect, self._client.on_subscribe = self._on_connect, self._on_subscribe
        self._client.on_message = self._take
        if match[2]:
            self._client.username_pw_set(unquote(match[2]), os.environ.get(MQTT_ENV))
        if tls:  # trusts what this system trusts, or the file that SSL_CERT_FILE names
            context = ssl.create_default_context()
            context.sslsocket_class = _TlsSocket
            self._client.tls_set_context(context)
        try:
            self._connect(port, is_ended)
        except BaseException:
            self.close()
            raise

    def _connect(self, port: int, is_ended: Callable[[], bool]) -> None:
        end = time.monotonic() + CONNECT_TIMEOUT
        self._client.connect_timeout = CONNECT_TIMEOUT
        self._client.connect(self._host, port, keepalive=15)
        while self._answer is None:
            if is_ended() or time.monotonic() > end:
                raise TimeoutError(f"no answer within {CONNECT_TIMEOUT:g} s")
            self._work(READ_TIMEOUT)
        if self._answer >= _REFUSED:
            raise BadDevice(
                f"the broker {self._host} refuses this user or this topic (reason code {self._answer}):"
                f" mqtt://user@{self._host}/…, and set {MQTT_ENV}"
            )

    def _on_connect(self, client: Any, _data: Any, _flags: Any, code: Any, _properties: Any) -> None:
        self._answer = code.value if code.value >= _REFUSED else None
        client.subscribe(self._topic, 1)

    def _on_subscribe(self, _client: Any, _data: Any, _id: Any, codes: Any, _properties: Any) -> None:
        self._answer = max((code.value for code in codes), default=_REFUSED)

    def _take(self, _client: Any, _data: Any, message: Any) -> None:
        if not message.retain:  # else the broker had kept it: a value of unknown age
            self.lines += topic_lines(self._topic, message.topic, message.payload)

    def gather(self) -> None:
        """Take what has arrived."""
        known = len(self.lines)
        self._work(READ_TIMEOUT)
        while known < len(self.lines) < MAX_READ_BYTES:
            known = len(self.lines)
            self._work(0.0)

    def _work(self, timeout: float) -> None:
        """Let the client read one packet, or wait for one.

        Raises:
            BadDevice: the connection was lost, and there is neither a line to fetch nor a refusal: a broker that
                refuses closes the connection at once.
        """
        is_lost = self._client.loop(timeout) != 0
        if is_lost and not self.lines and (self._answer or 0) < _REFUSED:
            raise OSError("the broker closed the connection")

    def close(self) -> None:
        """Disconnect from the broker."""
        client = self._client
        client.disconnect()
        if client.socket() is not None:
            client.socket().close()
        client.on_connect = client.on_subscribe = client.on_message = None  # paho holds sockets until it is freed


# udp://:port: datagrams of lines, such as Teleplot's, from every sender that reaches the port.
#
# There is no connection: the port is bound, and whatever arrives is read. Only this machine reaches it unless the
# address names an interface, because anyone who reaches it can send.


LOOPBACK = "127.0.0.1"
"""What is bound where the address names no interface: this machine alone reaches it."""


class UdpPort(MessagePort):
    """A port of this machine, on one interface or on all."""

    prefixes = ("udp://",)
    check = staticmethod(partial(host_and_port, default=LOOPBACK))

    def __init__(self, spec: PortSpec, _is_ended: Callable[[], bool], _last: OpenPort | None) -> None:
        """Bind it; see OpenPort."""
        host, port = host_and_port(spec.url, LOOPBACK)
        self.when_silent = f"do firewalls let the board reach it? udp://0.0.0.0:{port} is open to all networks"
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            # Linux gives 2 × net.core.rmem_max at most.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
            self._socket.bind((host, port))
        except BaseException:
            self.close()
            raise

    def gather(self) -> None:
        """Take what has arrived."""
        # None waits; errors of earlier datagrams.
        with suppress(TimeoutError, BlockingIOError, InterruptedError, ConnectionError):
            self._socket.settimeout(READ_TIMEOUT)
            for _ in range(MAX_READ_BYTES):  # so that it also ends where only empty ones arrive
                self.lines += lines_of(self._socket.recv(65_535))
                if len(self.lines) >= MAX_READ_BYTES:
                    break
                self._socket.settimeout(0.0)

    def close(self) -> None:
        """Release the port."""
        self._socket.close()
