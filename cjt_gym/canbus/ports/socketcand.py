"""A server of the socketcand protocol in raw mode, for clients such as python-can's own.

The protocol is that of the daemon socketcand (https://github.com/linux-can/socketcand): a client
is greeted with ``< hi >``, opens a channel, asks for raw mode, and then sends and gets frames as
text. Several clients share the bus: what one sends, the others see.
"""

from __future__ import annotations

import re
import select
import socket
import time
from collections.abc import Sequence
from typing import final

import can

from cjt_gym.errors import ConfigurationError

QUIET = 0.05
"""Time after the change to raw mode for which a client gets no frames [s].

Clients read the answer to the change on its own; a frame right behind it would confuse them.
"""
LONGEST = 4096  # bytes of an unfinished message that are kept; a frame takes 60 or so
_WORDS = re.compile(rb"<[^<>]*>")
_LIMIT = 64


@final
class _Client:
    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.unread = b""
        self.unsent = b""
        self.is_open = False
        self.raw_from = float("inf")

    @property
    def is_raw(self) -> bool:
        """Whether the client gets frames."""
        return time.monotonic() >= self.raw_from


@final
class SocketcandPort:
    """A socketcand server that serves one channel to any number of clients."""

    def __init__(self, host: str = "127.0.0.1", port: int = 29536, channel: str = "can0") -> None:
        """Start the server; port 0 takes a free one."""
        self.channel = channel
        self._clients: list[_Client] = []
        self._server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._server.bind((host, port))
        except (OSError, OverflowError) as error:
            self._server.close()
            raise ConfigurationError(
                f"A socketcand server cannot listen on {host}:{port}: {error}. Give another host "
                "or port in [bus], or stop what holds it."
            ) from error
        self._server.listen()
        self._server.setblocking(False)

    @property
    def port(self) -> int:
        """TCP port."""
        return int(self._server.getsockname()[1])

    @property
    def address(self) -> str:
        """Channel, host and port."""
        host, port = self._server.getsockname()
        return f"socketcand {self.channel}@{host}:{port}"

    def receive(self, timeout: float) -> Sequence[can.Message]:
        """Return the frames that clients sent, waiting up to `timeout` [s]."""
        readable: list[socket.socket] = [self._server, *(c.connection for c in self._clients)]
        blocked = [c.connection for c in self._clients if c.unsent]
        ready, writable, _ = select.select(readable, blocked, [], max(timeout, 0.0))
        if self._server in ready:
            self._accept()
        found: list[can.Message] = []
        for client in list(self._clients):
            if client.connection in writable:
                self._write(client, b"")
            if client.connection in ready:
                found += self._read(client)
        return found

    def send(self, message: can.Message) -> None:
        """Send a frame to every client in raw mode."""
        self._spread(message, None)

    def close(self) -> None:
        """Close all connections and stop the server."""
        for client in list(self._clients):
            self._drop(client)
        self._server.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._server.accept()
        except OSError:  # it hung up again
            return
        client = _Client(connection)
        self._clients.append(client)
        self._write(client, b"< hi >")

    def _drop(self, client: _Client) -> None:
        client.connection.close()
        if client in self._clients:
            self._clients.remove(client)

    def _write(self, client: _Client, text: bytes) -> None:
        """Send without waiting; a client that does not read loses frames."""
        client.unsent += text if len(client.unsent) < LONGEST * 16 else b""
        try:
            client.unsent = client.unsent[client.connection.send(client.unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self._drop(client)

    def _read(self, client: _Client) -> list[can.Message]:
        try:
            received = client.connection.recv(1 << 16)
        except BlockingIOError:
            return []
        except OSError:
            received = b""
        if not received:
            self._drop(client)
            return []
        client.unread += received
        frames, end = [], 0
        for match in _WORDS.finditer(client.unread):
            end = match.end()
            message = self._obey(client, match.group()[1:-1].split())
            if message is not None:
                self._spread(message, client)
                frames.append(message)
        client.unread = client.unread[end:][-LONGEST:]
        return frames

    def _spread(self, message: can.Message, sender: _Client | None) -> None:
        line = frame_text(message)
        for client in list(self._clients):
            if client is not sender and client.is_raw:
                self._write(client, line)

    def _obey(self, client: _Client, words: list[bytes]) -> can.Message | None:
        """Answer a command; return the frame that it sends, if any."""
        name = words[0] if words else b""
        if name == b"open" and len(words) == 2:
            client.is_open = words[1].decode("ascii", "replace") == self.channel
            answer = "< ok >" if client.is_open else f"< error could not open {words[1]!r} >"
            self._write(client, answer.encode())
        elif name == b"echo":
            self._write(client, b"< echo >")
        elif name == b"rawmode" and client.is_open:
            client.raw_from = time.monotonic() + QUIET
            self._write(client, b"< ok >")
        elif name == b"send" and client.is_open:
            message = parse_send(words[1:])
            if message is None:
                self._write(client, b"< error unknown command >")
            return message
        else:
            self._write(client, b"< error unknown command >")
        return None


def parse_send(words: Sequence[bytes]) -> can.Message | None:
    """Return the frame given by the words after ``send``, or None.

    Example:
        >>> parse_send([b"123", b"2", b"a", b"ff"]).data.hex()
        '0aff'
    """
    try:
        identifier, length = int(words[0], 16), int(words[1], 16)
        data = bytes(int(word, 16) for word in words[2:])
    except (ValueError, IndexError):
        return None
    extended = len(words[0]) == 8
    highest = 0x1FFFFFFF if extended else 0x7FF
    if length > _LIMIT or length != len(data) or not 0 <= identifier <= highest:
        return None
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=extended,
        data=data,
        is_fd=length > 8,
        timestamp=time.time(),
    )


def frame_text(message: can.Message) -> bytes:
    """Return a frame as sent to a client in raw mode.

    Example:
        >>> frame_text(can.Message(arbitration_id=1, data=b"xy", is_extended_id=False))
        b'< frame 001 0.000000 7879 >'
    """
    width = 8 if message.is_extended_id or message.is_error_frame else 3
    kind = "error" if message.is_error_frame else "frame"
    data = "" if message.is_remote_frame else message.data.hex()
    head = f"< {kind} {message.arbitration_id:0{width}X} {message.timestamp:.6f} "
    return (head + data + " >").encode("ascii")
