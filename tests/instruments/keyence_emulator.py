"""A controller in a thread: both protocols, and everything that can go wrong on a network."""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

from instruments.keyence import Status
from instruments.keyence._connection import Reading

LK_REQUEST = bytes([7, 0, 7, 0x14, 0, 0, 0])


class Emulator:
    """Answers with ``values(n)`` for its n-th reading, unless ``faults[n]`` says otherwise.

    Faults: ``close`` (hangs up), ``short`` (half an answer, then hangs up), ``silent`` (no answer),
    ``late`` (after ``delay``), ``slow`` (byte by byte, each after ``delay``), ``garbage``, ``long`` (too many bytes).
    """

    def __init__(
        self,
        protocol: str,
        values: Callable[[int], list[int]],
        faults: dict[int, str] | None = None,
        delay: float = 0.05,
    ) -> None:
        self.protocol, self.values, self.faults = protocol, values, faults or {}
        self.delay = delay
        self.answered = 0
        self.connections = 0
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]
        self.open: list[socket.socket] = []
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self) -> None:
        with contextlib.suppress(OSError):  # the server was closed
            while True:
                peer, _ = self.server.accept()
                self.connections += 1
                self.open.append(peer)
                threading.Thread(target=self.talk, args=(peer,), daemon=True).start()

    def talk(self, peer: socket.socket) -> None:
        end = LK_REQUEST if self.protocol == "lk-g5000" else b"\r\n"
        data = b""
        with contextlib.suppress(OSError), peer:
            while piece := peer.recv(4096):
                data += piece
                while end in data:
                    request, data = data[: data.index(end)], data[data.index(end) + len(end) :]
                    if not self.answer(peer, request):
                        return

    def answer(self, peer: socket.socket, request: bytes) -> bool:
        number = self.answered
        self.answered += 1
        fault = self.faults.get(number, "")
        reply = self.reply(request, self.values(number))
        if fault == "close":
            return False
        if fault == "short":
            peer.sendall(reply[: len(reply) // 2])
            return False
        if fault == "silent":
            return True
        if fault == "late":
            time.sleep(self.delay)
        if fault in ("garbage", "long"):
            reply = b"x" * 2000 if fault == "long" else b"?!\r\n" if self.protocol == "dl-en1" else bytes(120)
        if fault == "slow":
            for byte in reply:
                peer.sendall(bytes([byte]))
                time.sleep(self.delay)
        else:
            peer.sendall(reply)
        return True

    def reply(self, request: bytes, values: list[int]) -> bytes:
        if self.protocol == "lk-g5000":
            every = values + [-1048576] * (12 - len(values))
            return bytes(68) + struct.pack("<12i", *every)
        if request != b"M0":
            return b"ER," + request[:2] + b",009\r\n"
        return b"M0," + ",".join(f"{v:+010d}" for v in values).encode() + b"\r\n"

    def close(self) -> None:
        self.server.close()
        for peer in self.open:
            peer.close()


@contextlib.contextmanager
def emulator(*arguments, **options) -> Iterator[Emulator]:
    made = Emulator(*arguments, **options)
    try:
        yield made
    finally:
        made.close()


class Counting:
    """A connection that counts up."""

    count = 0

    def read(self) -> Reading:
        self.count += 1
        return Reading((self.count,), (Status.VALID,))

    def close(self) -> None:
        return
