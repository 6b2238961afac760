"""Whole messages as lines: datagrams of udp://, and what a broker of mqtt:// passes on."""

from __future__ import annotations

import errno
import netrc
import os
import re
import select
import socket
import ssl
import struct
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any
from urllib.parse import unquote

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.grammar.cells import MISSING, is_number, split_measure
from kalscope.sources.grammar.line_format import find_labels, flattened, load_json, split_teleplot, teleplot_flags
from kalscope.sources.port.serial_port import connect_failure
from kalscope.sources.port.transport import (
    CONNECT_TIMEOUT,
    MAX_READ_BYTES,
    READ_TIMEOUT,
    Endpoint,
    OpenPort,
    Transport,
    quoted,
    short,
)

# What whole messages hold, as lines for the line parser: samples of Teleplot, or lines as they are. Opens nothing.
#
# A sender of datagrams leaves out the > with which a line of Teleplot begins on a serial port. Here it is put back,
# so that one parser reads both.


MAX_SHOWN = 200
"""Bytes of a binary message that are passed on, as one line that is then rejected."""

_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")
_LINE_END = re.compile(r"[\r\n]+")
_SHAPE = re.compile(r"3D\|[^\s|]")


def is_binary(data: bytes) -> bool:
    """Whether a message holds bytes that no text has."""
    return _BINARY.search(data) is not None


def decoded(data: bytes) -> str:
    """A message as text: UTF-8, or where it is not, Latin-1, as the line parser reads it."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def one_line(data: bytes) -> bytes:
    """The beginning of a message on one line, with a NUL byte by which the parser rejects it, and its newline."""
    return b"\0" + data[:MAX_SHOWN].replace(b"\r", b" ").replace(b"\n", b" ") + b"\n"


def lines_of(data: bytes) -> bytes:
    r"""The lines of one message, each with its \n; b"" for none. A binary one is one line, to be rejected."""
    if is_binary(data):
        return one_line(data)
    lines = [_marked(line) for line in _LINE_END.split(decoded(data)) if line.strip()]
    return "".join(f"{line}\n" for line in lines).encode()


def _marked(line: str) -> str:
    """The line with the > of Teleplot before it, where it is one of Teleplot's and lacks it."""
    if line.lstrip().startswith(">"):
        return line
    marked = ">" + line.lstrip()
    plot = split_teleplot(marked)
    if plot is not None:
        values = [value for _, value in plot.samples]
        is_sample = any(is_number(value) for value in values) or all(value.lower() in MISSING for value in values)
        return line if is_number(plot.name) or not is_sample else marked
    return marked if not {"t", "xy"}.isdisjoint(teleplot_flags(marked)) or _SHAPE.match(line) else line


# Messages of MQTT as lines: the topic names the channel, the payload holds its value. Opens nothing.
#
# One topic alone sends lines as any board does, and a bare number takes the name of its last level. Of several
# topics each value becomes a line of Teleplot, `>barn/temperature:21.5`, so that topics may come and go.


MAX_PAYLOAD = 65_536
"""Bytes of one payload, as of one line: a larger one is a picture or a file."""
MAX_TOPIC = 200
"""Characters of the name that a topic gives to its channels; the rest is cut off."""

_CELLS = re.compile(r"[,;\s]+")
_NO_NAME = re.compile(r"[:;]")
_NO_MARK = re.compile(r"[>|§\x00-\x1f\x7f]")
_WILD = ("+", "#")


def check_topic(topic: str) -> None:
    """Raise BadSetting where a topic cannot be subscribed to."""
    levels = topic.split("/")
    wild = any(("+" in level and level != "+") or ("#" in level and level != "#") for level in levels)
    if not topic or wild or "#" in levels[:-1] or not topic.isprintable() or len(topic.encode()) > 65_535:
        raise BadSetting(
            f"a topic must have levels between /, + for a whole level, # for all that follow (got {topic!r:.100})"
        )


class Topics:
    """The topics of one subscription."""

    def __init__(self, subscribed: str) -> None:
        """Args: what is subscribed to, checked by `check_topic`."""
        levels = subscribed.split("/")
        wild = [i for i, level in enumerate(levels) if level in _WILD]
        self._skip = wild[0] if wild else len(levels) - 1
        self._is_one = not wild

    def lines(self, topic: str, payload: bytes, *, retained: bool = False) -> bytes:
        r"""The lines of one message, each with its \n.

        Args:
            topic: Its topic.
            payload: What it holds.
            retained: Whether the broker had kept it: a value of unknown age, of which only the names are used.
        """
        name = self._name(topic)
        if len(payload) > MAX_PAYLOAD:
            return _line(name, f"({len(payload)} bytes: a payload must have at most {MAX_PAYLOAD})")
        if is_binary(payload):
            return one_line(payload)
        text = decoded(payload).strip()
        values = list(_values(text))
        if self._is_one and [of for of, _, _ in values] != [""]:
            return f"# retained: {' '.join(text.split())}\n".encode() if retained else lines_of(payload)
        if not values:
            return _line(name, f"{' '.join(text.split())}|t")
        if retained:
            return b"".join(_line(name + of, "") for of, _, _ in values)
        return b"".join(_line(name + of, value + (f"§{unit}" if unit else "")) for of, value, unit in values)

    def _name(self, topic: str) -> str:
        levels = topic.split("/")
        name = "/".join(levels[self._skip :] or levels[-1:])
        return _printable(name).strip() or "topic"


def _printable(name: str) -> str:
    """A name without the marks of a line of Teleplot: a MAC address is AA-BB, not AA:BB."""
    return _NO_MARK.sub("_", _NO_NAME.sub("-", name))[:MAX_TOPIC]


def _line(name: str, value: str) -> bytes:
    return f">{name}:{value}\n".encode()


def _values(text: str) -> Iterable[tuple[str, str, str]]:
    """(end of the name, number, unit) of each value of a payload; nothing where it holds none."""
    if is_number(text) or text.lower() in MISSING - {""}:
        return [("", text, "")]
    if measure := split_measure(text):
        return [("", measure[0], measure[1])]
    if text.startswith(("{", "[")):
        return _of_json(text)
    found = find_labels(text)
    if found is not None:
        return _of_pairs((f".{label}", value) for label, value in found)
    cells = _CELLS.split(text)
    return [(f"[{i}]", cell, "") for i, cell in enumerate(cells)] if all(map(is_number, cells)) else []


def _of_json(text: str) -> Iterable[tuple[str, str, str]]:
    try:
        pairs = flattened(load_json(text))
    except ValueError:
        return []
    return _of_pairs((of if of.startswith("[") else f".{of}", value) for of, value in pairs or [])


def _of_pairs(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Those of the values that are numbers, with their units."""
    values: list[tuple[str, str, str]] = []
    for of, value in pairs:
        name = _printable(of)
        if is_number(value):
            values.append((name, value, ""))
        elif measure := split_measure(value):
            values.append((name, measure[0], measure[1]))
    return values


# The password of a broker: never in an address, which is shown, recorded and shared.


PASSWORD_VARIABLE = "KALSCOPE_MQTT_PASSWORD"
"""The environment variable that holds it."""
WHERE = f"set {PASSWORD_VARIABLE}, or write `machine HOST login USER password …` into ~/.netrc"
"""Where users put a password, for messages."""


def password_of(host: str, user: str) -> str | None:
    """The password of a user at a broker: from the environment, else from ~/.netrc; None where there is none.

    Raises:
        BadDevice: ~/.netrc cannot be read, or others can read it.
    """
    given = os.environ.get(PASSWORD_VARIABLE)
    if given is not None:
        return given
    try:
        found = netrc.netrc().hosts.get(host)  # an entry `default` is for any host: never sent
    except FileNotFoundError:
        return None
    except (netrc.NetrcParseError, OSError, UnicodeError) as error:
        # Nothing of its message is repeated: it may quote a password.
        raise BadDevice(
            f"~/.netrc must be readable for you alone, and hold `machine HOST login USER password …`"
            f" (got {type(error).__name__}): chmod 600 ~/.netrc, or set {PASSWORD_VARIABLE}"
        ) from None
    return found[2] if found is not None and found[0] == user else None


# mqtt://broker/topic and mqtts://: the messages that a broker passes on, by paho-mqtt.
#
# The reader thread of the port drives the client: it has no thread of its own, and it never reconnects by itself.
# The subscription has quality of service 1: what a sensor publishes so is acknowledged here, and sent again
# where it was lost. A session ends with its connection: what is published while there is none is never delivered.


PORT, TLS_PORT = 1883, 8883
"""Ports of mqtt:// and mqtts:// where the address names none."""
KEEP_ALIVE = 15
"""Seconds without a packet after which the broker is pinged."""
MAX_MESSAGE = 8 << 20
"""Bytes of a message beyond which the connection is given up: it cannot be refused in any other way."""
RECEIVE_BUFFER = 1 << 18
"""Bytes that the system may hold for one connection, and at most a hundred times as many that one step reads."""

_ADDRESS = re.compile(
    r"(mqtts?)://(?:([^@/\s]*)@)?(?:\[([0-9A-Fa-f:.]+)\]|([^/:?@\[\]\s]+))(?::([0-9]{1,5}))?/(.+)",
    re.IGNORECASE | re.DOTALL,
)
_WRONG_LOGIN = {134, 135}  # bad user name or password; not authorised


def _matched(address: str) -> re.Match[str]:
    """The parts of an address: scheme, user, host in brackets, host, port and topic.

    Raises:
        BadSetting: it is not mqtt://[user@]broker[:port]/topic.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or not 1 <= int(match[5] or PORT) <= 65_535:
        raise BadSetting(
            f"an address must be mqtt://broker/topic or mqtt://user@broker:port/topic (got {quoted(address)})"
        )
    check_topic(_topic(match[6]))
    return match


def _topic(written: str) -> str:
    """A topic, from how an address writes it: %40 is @. Nothing else is decoded: a % is rare in a topic."""
    return written.replace("%40", "@")


class MqttEndpoint(Endpoint):
    """A broker and a topic."""

    def __init__(self, address: str) -> None:
        """Take an address.

        Raises:
            BadSetting: as `_matched`, or paho-mqtt is not installed.
        """
        try:
            import paho.mqtt.client
        except ImportError:
            raise BadSetting(
                'mqtt:// needs paho-mqtt: pip install "kalscope[mqtt]" or pip install paho-mqtt'
            ) from None
        self._paho: Any = paho.mqtt.client
        match = _matched(address)
        self.device = address
        self._tls = match[1].lower() == "mqtts"
        self._user = unquote(match[2] or "")
        self._host = match[3] or match[4]
        self._port = int(match[5] or (TLS_PORT if self._tls else PORT))
        self._topic = _topic(match[6])
        self.when_silent = f"does anything publish on {self._topic}, and may this user read it?"

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Connect and subscribe; see Endpoint."""
        password = password_of(self._host, self._user) if self._user else None
        client = self._paho.Client(
            self._paho.CallbackAPIVersion.VERSION2, protocol=self._paho.MQTTv311, reconnect_on_failure=False
        )
        client.connect_timeout = CONNECT_TIMEOUT
        client.on_socket_open = _limit_buffer
        if self._user:
            client.username_pw_set(self._user, password)
        end = time.monotonic() + CONNECT_TIMEOUT

        def is_over() -> bool:
            return is_ended() or time.monotonic() > end

        if self._tls:
            client.tls_set_context(_trusting_system(is_over))
        port = MqttPort(self.device, client, Topics(self._topic))
        try:
            client.connect(self._host, self._port, KEEP_ALIVE)
            self._wait_for(port, is_over, "connected")
            client.subscribe(self._topic, 1)
            self._wait_for(port, is_over, "subscribed")
        except (OSError, UnicodeError) as error:
            port.close()
            raise BadDevice(self._failure(error)) from error
        return port

    @property
    def _what(self) -> str:
        return "a broker over TLS" if self._tls else "a broker"

    def _wait_for(self, port: MqttPort, is_over: Callable[[], bool], step: str) -> None:
        """Wait until the broker has accepted a step.

        Raises:
            BadDevice: it refuses, does not answer, or closes the connection.
        """
        while step not in port.answers:
            if is_over():
                raise BadDevice(f"{self._host}:{self._port} does not answer as {self._what} does")
            try:
                port.work(READ_TIMEOUT)
            except BadDevice:
                if step not in port.answers:  # a broker that refuses closes the connection at once
                    raise
        code = port.answers[step]
        if code < 128:
            return
        if step == "subscribed":
            raise BadDevice(f"the broker {self._host} does not let this user read {self._topic}")
        if code in _WRONG_LOGIN and self._user:
            raise BadDevice(f"the broker {self._host} refuses the user {self._user}, or the password: {WHERE}")
        if code in _WRONG_LOGIN:
            raise BadDevice(f"the broker {self._host} requires a user: mqtt://user@{self._host}/…, and {WHERE}")
        raise BadDevice(f"the broker {self._host} refuses the connection (code {code})")

    def _failure(self, error: Exception) -> str:
        """Why there is no connection."""
        if isinstance(error, BadDevice):
            return str(error)
        if isinstance(error, ssl.SSLCertVerificationError):
            return (
                f"the certificate of {self._host} is not trusted ({short(error.verify_message)}):"
                " set SSL_CERT_FILE=ca.pem to name your own authority"
            )
        if isinstance(error, ssl.SSLError) or (self._tls and isinstance(error, ConnectionResetError)):
            return f"{self._host}:{self._port} does not speak TLS ({short(str(error))}): is it mqtt://?"
        return connect_failure(self._host, self._port, error, self._what)


class MqttPort(OpenPort):
    """A subscription."""

    starts = "at a line"

    def __init__(self, name: str, client: Any, topics: Topics) -> None:
        """Args: the name in messages; the client of paho, not connected yet; how messages become lines."""
        self._name, self._client, self._topics = name, client, topics
        self._lines = bytearray()
        self.answers: dict[str, int] = {}
        """The broker's answer to "connected" and "subscribed": a reason code of MQTT 5, 128 and more refuse."""
        client.on_connect, client.on_subscribe = self._on_connect, self._on_subscribe
        client.on_message = self._take

    def _on_connect(self, _client: Any, _data: Any, _flags: Any, code: Any, _properties: Any) -> None:
        self.answers["connected"] = code.value

    def _on_subscribe(self, _client: Any, _data: Any, _id: Any, codes: Any, _properties: Any) -> None:
        self.answers["subscribed"] = max((code.value for code in codes), default=128)

    def _take(self, _client: Any, _data: Any, message: Any) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:
            topic = "topic"
        self._lines += self._topics.lines(topic, message.payload, retained=bool(message.retain))

    def fetch(self) -> bytes:
        """Lines of the messages that have arrived; see OpenPort. The last line is whole, even beyond the limit."""
        wait = READ_TIMEOUT
        try:
            for _ in range(MAX_READ_BYTES):  # so that it also ends where only empty ones arrive
                if len(self._lines) >= MAX_READ_BYTES or not self.work(wait):
                    break
                wait = 0.0
        except BadDevice:
            if not self._lines:  # else the next call reports it
                raise
        data = bytes(self._lines)
        self._lines.clear()
        return data

    def work(self, timeout: float) -> bool:
        """Let the client read one packet, or wait for one; return whether there was one.

        Raises:
            BadDevice: the connection was lost.
        """
        connection = self._client.socket()
        if connection is None:
            raise BadDevice(f"the broker of {self._name} closed the connection")
        pending = isinstance(connection, ssl.SSLSocket) and connection.pending() > 0
        ready = pending or bool(select.select([connection], [], [], timeout)[0])
        codes = [self._client.loop_read()] if ready else []
        if self._client.want_write():
            codes.append(self._client.loop_write())
        codes.append(self._client.loop_misc())
        if any(codes):
            raise BadDevice(f"the broker of {self._name} closed the connection")
        coming = getattr(self._client, "_in_packet", {}).get("remaining_length", 0)
        if coming > MAX_MESSAGE:
            raise BadDevice(f"a message of {coming} bytes comes from {self._name}: at most {MAX_MESSAGE} are read")
        return ready

    def waiting(self) -> int:
        """1 where a packet waits."""
        connection = self._client.socket()
        return 0 if connection is None else len(select.select([connection], [], [], 0)[0])

    def close(self) -> None:
        """Disconnect from the broker."""
        self._client.disconnect()
        connection = self._client.socket()
        if connection is not None:
            connection.close()


def _trusting_system(is_over: Callable[[], bool]) -> ssl.SSLContext:
    """TLS that trusts what this system trusts, or the file that SSL_CERT_FILE names.

    Args:
        is_over: True once there is no more time for a handshake.
    """

    class Handshake(ssl.SSLSocket):
        """A connection whose handshake ends in time, and which closes where it fails: paho would leave it open."""

        def do_handshake(self, block: bool = False) -> None:
            del block
            timeout = self.gettimeout()
            self.settimeout(0)
            try:
                while not _shake(super().do_handshake, self):
                    if is_over():
                        raise TimeoutError
            except OSError:
                self.close()
                raise
            self.settimeout(timeout)

    context = ssl.create_default_context()
    context.sslsocket_class = Handshake
    return context


def _shake(step: Callable[[], None], connection: ssl.SSLSocket) -> bool:
    """Continue a handshake for READ_TIMEOUT at most; return whether it is done."""
    try:
        step()
    except ssl.SSLWantReadError:
        select.select([connection], [], [], READ_TIMEOUT)
        return False
    except ssl.SSLWantWriteError:
        select.select([], [connection], [], READ_TIMEOUT)
        return False
    return True


def _limit_buffer(_client: Any, _data: Any, connection: Any) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)


MQTT = Transport(
    ("mqtt://", "mqtts://"),
    "mqtt://broker/topic",
    _matched,
    lambda address, _baud, _reset: MqttEndpoint(address),
    password=WHERE,
)
"""Messages of a broker."""


# udp://:port: datagrams of lines, such as Teleplot's, from every sender that reaches the port.
#
# There is no connection: the port is bound, and whatever arrives is read. Only this machine reaches it unless the
# address names an interface, because anyone who reaches it can send.


LOOPBACK = "127.0.0.1"
"""What is bound where the address names no interface: this machine alone reaches it."""
MAX_DATAGRAM = 65_535
"""Bytes of one datagram: none can be longer."""
UDP_RECEIVE_BUFFER = 4 << 20
"""Bytes that the system is asked to buffer; Linux gives 2 × net.core.rmem_max at most."""

_UDP_ADDRESS = re.compile(r"udp://(?:(?:\[([0-9A-Fa-f:.%\w]+)\]|([^/:?@\[\]\s]*)):)?([0-9]{1,5})/?", re.IGNORECASE)
_MEMORY, _DROPS = 55, 8  # Linux: SO_MEMINFO, whose ninth number counts the dropped datagrams


def interface_and_port(address: str) -> tuple[str, int]:
    """The interface and the port of an address.

    Raises:
        BadSetting: it is not udp://:port or udp://interface:port.
    """
    match = _UDP_ADDRESS.fullmatch(address)
    if match is None or not 1 <= int(match[3]) <= 65_535:
        raise BadSetting(
            f"an address must be udp://:47269, or udp://0.0.0.0:47269 for all networks (got {quoted(address)})"
        )
    return match[1] or match[2] or LOOPBACK, int(match[3])


class UdpEndpoint(Endpoint):
    """A port of this machine, on one interface or on all."""

    def __init__(self, address: str) -> None:
        """Take an address; raises BadSetting as `interface_and_port`."""
        self.device = address
        self._host, self._port = interface_and_port(address)
        if self._host in (LOOPBACK, "localhost", "::1"):
            self.when_silent = (
                f"only this computer can send to {self._host}; udp://0.0.0.0:{self._port} is open to all networks"
            )
        else:
            self.when_silent = "does the board send to this computer and this port, and does a firewall let it in?"

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Bind the port; see Endpoint."""
        del is_ended
        try:
            found = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
            family, kind, protocol, _, place = found[0]
            bound = socket.socket(family, kind, protocol)
        except (OSError, UnicodeError) as error:
            raise BadDevice(f"{self._host} is not an address of this computer ({short(str(error))})") from error
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UDP_RECEIVE_BUFFER)
            bound.bind(place)
        except OSError as error:
            bound.close()
            raise BadDevice(self._refusal(error)) from error
        return UdpPort(self.device, bound)

    def _refusal(self, error: OSError) -> str:
        if error.errno == errno.EADDRINUSE:
            return f"port {self._port} is in use by another program: close it, or send to another port"
        if error.errno == errno.EADDRNOTAVAIL:
            return f"{self._host} is not an address of this computer: 0.0.0.0 means all of its addresses"
        if error.errno == errno.EACCES:
            return f"port {self._port} needs more privileges: choose one above 1023"
        return f"{self.device} cannot be bound ({short(str(error))})"


class UdpPort(OpenPort):
    """A bound port."""

    starts = "at a line"

    def __init__(self, name: str, bound: socket.socket) -> None:
        """Args: the name in messages; the socket, which it closes."""
        self._name, self._socket = name, bound
        self._reported = self._drop_count()
        bound.setblocking(False)

    def fetch(self) -> bytes:
        """Lines of the datagrams that have arrived; see OpenPort. The last line is whole, even beyond the limit."""
        lines = bytearray()
        try:
            if select.select([self._socket], [], [], READ_TIMEOUT)[0]:
                for _ in range(MAX_READ_BYTES):  # so that it also ends where only empty ones arrive
                    if len(lines) >= MAX_READ_BYTES or (data := self._receive()) is None:
                        break
                    lines += lines_of(data)
        except OSError as error:
            raise BadDevice(f"{self._name} can no longer be read ({short(str(error))})") from error
        return bytes(lines)

    def _receive(self) -> bytes | None:
        """The next datagram; None where none waits. Errors of earlier datagrams are ignored."""
        try:
            return self._socket.recv(MAX_DATAGRAM)
        except (BlockingIOError, InterruptedError, ConnectionError):
            return None

    def take_lost(self) -> int:
        """Datagrams that the system dropped since the last call: they came faster than they were fetched."""
        now, before = self._drop_count(), self._reported
        self._reported = now
        return (now - before) % (1 << 32)

    def _drop_count(self) -> int:
        """How many datagrams the system has dropped so far; 0 where it does not report it."""
        if sys.platform != "linux":
            return 0
        try:
            info = self._socket.getsockopt(socket.SOL_SOCKET, _MEMORY, 64)
        except OSError:
            return 0
        return struct.unpack_from("=I", info, 4 * _DROPS)[0] if len(info) >= 4 * (_DROPS + 1) else 0

    def waiting(self) -> int:
        """1 where a datagram waits."""
        return len(select.select([self._socket], [], [], 0)[0])

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


UDP = Transport(
    ("udp://",), "udp://:47269", interface_and_port, lambda address, _baud, _reset: UdpEndpoint(address)
)
"""Datagrams."""
