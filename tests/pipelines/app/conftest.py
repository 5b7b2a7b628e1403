"""A page that is served in a thread, and how it is asked."""

import json
import shutil
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from pipelines.app import Served, open as serve


@dataclass
class Page:
    served: Served

    @property
    def address(self) -> str:
        return self.served.address

    @property
    def port(self) -> int:
        return int(urlsplit(self.address).port or 0)

    @property
    def path(self) -> str:
        return urlsplit(self.address).path

    def ask(
        self, path: str, body: Any = None, *, method: str = "", whole: bool = False, **headers: str
    ) -> tuple[int, bytes]:
        """Send one request; headers are written with _ for -."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        method = method or ("GET" if body is None else "POST")
        given = {"Host": f"127.0.0.1:{self.port}"}
        if method == "POST":
            given |= {"Origin": f"http://127.0.0.1:{self.port}", "Content-Type": "application/json"}
        given |= {name.replace("_", "-"): text for name, text in headers.items()}
        data = body if isinstance(body, bytes | None) else json.dumps(body).encode()
        connection.request(method, path if whole else self.path + path, data, {k: v for k, v in given.items() if v})
        answer = connection.getresponse()
        found = answer.status, answer.read()
        self.headers = dict(answer.getheaders())
        connection.close()
        return found

    def told(self, path: str, body: Any = None) -> dict[str, Any]:
        status, text = self.ask(path, body)
        assert status == 200, text
        return json.loads(text)

    def propose(self) -> list[str]:
        """Write the session that is proposed from the files as it is."""
        found = self.told("api/session")
        return self.told("api/write", {"base": found["base"], "edits": found["edits"]})["written"]


@pytest.fixture
def serving() -> Iterator[Callable[[Path], Page]]:
    """Serve folders until the end of a test."""
    running: list[tuple[Served, threading.Thread]] = []

    def start(folder: Path) -> Page:
        served = serve(folder)
        thread = threading.Thread(target=served.run)
        thread.start()
        running.append((served, thread))
        with socket.create_connection(("127.0.0.1", int(urlsplit(served.address).port or 0)), timeout=30):
            return Page(served)

    yield start
    for served, thread in running:
        served.stop()
        thread.join(60)
        assert not thread.is_alive()


@pytest.fixture
def raw(small_session: Path, tmp_path: Path) -> Path:
    """Recordings and records without a session.toml."""
    folder = tmp_path / "Messung vom 14. Mai"
    shutil.copytree(small_session, folder, ignore=shutil.ignore_patterns("session.toml", "truth"))
    return folder


@pytest.fixture
def page(raw: Path, serving: Callable[[Path], Page]) -> Page:
    return serving(raw)
