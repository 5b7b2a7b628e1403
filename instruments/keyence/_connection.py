"""Readings of a running Keyence controller over TCP, tested against an emulator only.

Two protocols, as far as they are publicly documented: the binary one of the LK-G5000 and the ASCII one of the IL series
with a DL-EN1 unit. A controller sends whole numbers; decimal sign and unit are settings of its display.
"""

import re
import socket
import struct
import time
from typing import NamedTuple

from instruments.keyence._markers import Status, marker_status
from labpipe.errors import InputError, SourceError

LK_G5000, DL_EN1 = "lk-g5000", "dl-en1"
LK_PORT = 24687  # of the LK-G5000; that of a DL-EN1 unit is set on the unit
_REQUESTS = {LK_G5000: bytes([7, 0, 7, 0x14, 0, 0, 0]), DL_EN1: b"M0\r\n"}
_LK_BYTES, _LK_OFFSET, _LK_VALUES = 116, 68, struct.Struct("<12i")
_UNUSED = -1048576  # 0xFFF00000, of an output that is not used
LARGEST = 9_999_999  # seven digits are shown on a display; a larger number is no reading


class Reading(NamedTuple):
    """One answer: a whole number and a state for each output."""

    counts: tuple[int, ...]
    states: tuple[Status, ...]


class Connection:
    """An open connection, to be closed after use; ``timeout`` [s] holds for it and for each whole answer.

    ``protocol`` is "lk-g5000" or "dl-en1"; ``outputs`` are numbers of outputs or amplifiers, from 1. Raises SourceError
    without a controller at the address, InputError for a protocol or an output that does not exist.
    """

    def __init__(self, protocol: str, host: str, port: int, outputs: tuple[int, ...], timeout: float) -> None:
        most = 12 if protocol == LK_G5000 else 16
        if protocol not in _REQUESTS or len(set(outputs)) != len(outputs) or not all(0 < n <= most for n in outputs):
            raise InputError(f'outputs of "{protocol}" are different numbers from 1 to {most}, found {list(outputs)}')
        self.address, self._protocol, self._outputs, self._timeout = f"{host}:{port}", protocol, outputs, timeout
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except OSError as error:
            hint = "Is the controller on, its Ethernet set up, and the port right?"
            raise SourceError(self.address, f"no connection: {error.strerror or error}", hint=hint) from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # else each small request waits 40 ms

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def read(self) -> Reading:
        """Ask once; SourceError if the answer is late, broken off, an error of the controller, or no reading."""
        try:
            deadline, answer = time.monotonic() + self._timeout, b""
            self._socket.settimeout(self._timeout)
            self._socket.sendall(_REQUESTS[self._protocol])
            while not (len(answer) >= _LK_BYTES if self._protocol == LK_G5000 else answer.endswith(b"\r\n")):
                left = deadline - time.monotonic()
                if left <= 0:
                    raise TimeoutError
                self._socket.settimeout(left)
                piece = self._socket.recv(1024)
                if not piece or len(answer) > 1024:
                    text = f"the connection was closed or flooded after {len(answer)} bytes of an answer"
                    raise ConnectionError(text)
                answer += piece
        except OSError as error:
            said = f"no complete answer within {self._timeout:g} s" if isinstance(error, TimeoutError) else str(error)
            raise SourceError(self.address, said) from None
        counts: tuple[int, ...] = ()
        name, *cells = answer.rstrip(b"\r\n").split(b",")
        if self._protocol == LK_G5000 and len(answer) == _LK_BYTES:
            every = _LK_VALUES.unpack_from(answer, _LK_OFFSET)
            # the bytes before the values are not documented: an answer is recognised by values that fit a display
            if 2 * sum(abs(n) <= LARGEST for n in every) >= len(every):
                counts = tuple(every[n - 1] for n in self._outputs)
        elif name == b"M0" and len(cells) >= max(self._outputs) and all(re.fullmatch(rb"[+-]\d{9}", c) for c in cells):
            counts = tuple(int(cells[n - 1]) for n in self._outputs)
        if not counts:
            hint = "Something else may answer at this port, or a sensor is missing; the manual lists error codes."
            raise SourceError(self.address, f"found the answer {answer[:24]!r}, which holds no readings", hint=hint)
        states = [
            Status.INVALID
            if count == _UNUSED
            else marker_status(f"{count:+010d}") or (Status.VALID if abs(count) <= LARGEST else Status.SUSPECT)
            for count in counts
        ]
        return Reading(counts, tuple(states))
