"""Poll a running Keyence controller for its readings over TCP.

Two protocols, as far as they are publicly documented: the binary one of the LK-G5000 (port 24687)
and the ASCII one of the IL series behind a DL-EN1 unit. A controller sends whole numbers; where
the decimal sign stands, and the unit, are settings of its display that must be given here.

Tested against an emulator only: no such controller was at hand.
"""

import re
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType

from instruments.keyence._markers import Status
from labpipe.errors import InputError, SourceError

LK_G5000, DL_EN1 = "lk-g5000", "dl-en1"
LK_PORT = 24687
"""Port of the LK-G5000; that of a DL-EN1 unit is set on the unit."""

_LK_REQUEST = bytes([7, 0, 7, 0x14, 0, 0, 0])
_LK_REPLY = 116
"""Bytes of a reply; twelve outputs of four bytes end it."""
_LK_VALUES = struct.Struct("<12i")
_LK_OFFSET = 68
_LK_INVALID = -1048576  # 0xFFF00000
_LK_LARGEST = 9_999_999
"""Seven digits are what a display shows; a larger number is no reading."""

_EN1_REQUEST = b"M0\r\n"
_EN1_LONGEST = 1024
"""Bytes; a line of readings of sixteen amplifiers takes a fifth of it."""
_EN1_MARKERS = {
    100000000: Status.ALARM,
    99999999: Status.RANGEOVER_P,
    -99999999: Status.RANGEOVER_N,
    -99999998: Status.INVALID,
}
_EN1_VALUE = re.compile(rb"[+-][0-9]{9}")


class ProtocolError(SourceError):
    """The controller answered something that its protocol does not know, or refused."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One answer: a whole number and a state for each output that was asked for."""

    counts: tuple[int, ...]
    states: tuple[Status, ...]


class Connection:
    """An open connection to a controller; closes itself at the end of a ``with`` block.

    Parameters
    ----------
    protocol : {"lk-g5000", "dl-en1"}
        What the controller speaks.
    host, port : str, int
        Its address.
    outputs : sequence of int
        Outputs (of the LK-G5000) or amplifiers (in the order of a DL-EN1), counted from 1.
    timeout : float [s]
        For the connection and for every answer, from its request to its last byte.

    Raises
    ------
    SourceError
        There is nobody at that address.
    InputError
        The protocol or an output does not exist.
    """

    def __init__(
        self, protocol: str, host: str, port: int, outputs: Sequence[int] = (1,), timeout: float = 1.0
    ) -> None:
        if protocol not in _READ:
            raise InputError(f'unknown protocol "{protocol}"; expected one of {", ".join(_READ)}')
        most = _LK_VALUES.size // 4 if protocol == LK_G5000 else 16
        wrong = [n for n in outputs if not 1 <= n <= most]
        if wrong or not outputs or len(set(outputs)) != len(outputs):
            raise InputError(f"outputs are different numbers from 1 to {most}, found {list(outputs)}")
        self.address = f"{host}:{port}"
        self._outputs = tuple(outputs)
        self._ask = _READ[protocol]
        self._timeout = timeout
        self._deadline = 0.0
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except OSError as error:
            raise SourceError(
                self.address,
                f"no connection: {error.strerror or error}",
                hint="Is the controller on, its Ethernet set up, and the port right?",
            ) from None
        # Every request is one small packet; waiting to fill it would cost 40 ms.
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self) -> Reading:
        """Ask once.

        Raises
        ------
        ProtocolError
            The answer makes no sense, or is an error message of the controller.
        SourceError
            The connection broke or the answer did not come in time.
        """
        self._deadline = time.monotonic() + self._timeout
        try:
            return self._ask(self, self._outputs)
        except TimeoutError:
            raise SourceError(self.address, f"no complete answer within {self._timeout:g} s") from None
        except OSError as error:
            raise SourceError(self.address, f"the connection broke: {error.strerror or error}") from None

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def __enter__(self) -> "Connection":
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the connection."""
        self.close()

    def send(self, request: bytes) -> None:
        """Send a request."""
        self._socket.settimeout(self._left())
        self._socket.sendall(request)

    def _left(self) -> float:
        """Return the seconds that are left for the answer."""
        left = self._deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError
        return left

    def receive(self, is_whole: Callable[[bytes], bool], longest: int) -> bytes:
        """Collect an answer that may come in pieces.

        Raises
        ------
        ProtocolError
            The controller closed the connection, or goes on beyond the longest answer.
        """
        data = b""
        while not is_whole(data):
            if len(data) > longest:
                raise ProtocolError(self.address, f"found {len(data)} bytes without an end")
            self._socket.settimeout(self._left())
            piece = self._socket.recv(4096)
            if not piece:
                raise ProtocolError(self.address, f"the controller closed the connection after {len(data)} bytes")
            data += piece
        return data


def _ask_lk(connection: Connection, outputs: tuple[int, ...]) -> Reading:
    connection.send(_LK_REQUEST)
    reply = connection.receive(lambda data: len(data) >= _LK_REPLY, _LK_REPLY)
    if len(reply) != _LK_REPLY:
        raise ProtocolError(connection.address, f"found an answer of {len(reply)} bytes, expected {_LK_REPLY}")
    every = _LK_VALUES.unpack_from(reply, _LK_OFFSET)
    # What stands before the values is not documented, so an answer is told by them: outputs that
    # are not used are invalid, the others fit their display.
    if sum(_state(n) != Status.SUSPECT for n in every) < len(every) // 2:
        message = f"found the answer {reply[:12]!r}…, which holds no readings"
        raise ProtocolError(
            connection.address, message, hint="Something else may answer at this port; compare address and port."
        )
    counts = tuple(every[n - 1] for n in outputs)
    return Reading(counts, tuple(map(_state, counts)))


def _state(count: int) -> Status:
    if count == _LK_INVALID:
        return Status.INVALID
    return Status.VALID if abs(count) <= _LK_LARGEST else Status.SUSPECT


def _ask_en1(connection: Connection, outputs: tuple[int, ...]) -> Reading:
    connection.send(_EN1_REQUEST)
    line = connection.receive(lambda data: data.endswith(b"\r\n"), _EN1_LONGEST).rstrip(b"\r\n")
    name, *cells = line.split(b",")
    if name == b"ER":
        code = b",".join(cells).decode("ascii", "replace")
        raise ProtocolError(
            connection.address,
            f'the controller answered with the error "ER,{code}"',
            hint="The manual of the DL-EN1 lists the codes; is a sensor amplifier connected?",
        )
    if name != b"M0" or not cells or not all(_EN1_VALUE.fullmatch(cell) for cell in cells):
        found = line[:60].decode("ascii", "replace")
        raise ProtocolError(connection.address, f'found the answer "{found}", expected for example "M0,+000012345"')
    if max(outputs) > len(cells):
        message = f"found readings of {len(cells)} amplifiers, asked for number {max(outputs)}"
        raise ProtocolError(connection.address, message)
    counts = tuple(int(cells[n - 1]) for n in outputs)
    return Reading(counts, tuple(_EN1_MARKERS.get(n, Status.VALID) for n in counts))


_READ: dict[str, Callable[[Connection, tuple[int, ...]], Reading]] = {LK_G5000: _ask_lk, DL_EN1: _ask_en1}
