"""mqtt://broker/topic and mqtts://: the messages that a broker passes on, by paho-mqtt.

The reader thread of the port drives the client: it has no thread of its own, and it never reconnects by itself.
The subscription has quality of service 1: what a sensor publishes so is acknowledged here, and sent again
where it was lost. A session ends with its connection: what is published while there is none is never delivered.
"""

from __future__ import annotations

import re
import select
import socket
import ssl
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.transports.limits import CONNECT_TIMEOUT, MAX_READ_BYTES, READ_TIMEOUT
from kalscope.sources.port.transports.messages.broker_login import WHERE, password_of
from kalscope.sources.port.transports.messages.topics import Topics, check_topic
from kalscope.sources.port.transports.network import connect_failure
from kalscope.sources.port.transports.transport import Endpoint, OpenPort, Transport
from kalscope.sources.port.transports.words import quoted, short

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
