"""The server behind the page, and the verb that starts it."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import SourceError
from pipelines.app._answers import Answers
from pipelines.app._guard import Guard

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette

_HOST = "127.0.0.1"


@dataclass(slots=True)
class Served:
    """A page that is served until :meth:`run` returns.

    ``address`` opens it; whoever knows it may use the page.
    """

    folder: Path
    address: str
    answers: Answers | None = field(repr=False)
    server: uvicorn.Server = field(repr=False)
    listening: socket.socket = field(repr=False)

    def run(self) -> None:
        """Answer until Ctrl-C or :meth:`stop`; a run that goes on is stopped then, its results are kept."""
        try:
            self.server.run(sockets=[self.listening])
        finally:
            if self.answers is not None:
                self.answers.runs.close()
            self.listening.close()

    def stop(self) -> None:
        """Let :meth:`run` return."""
        self.server.should_exit = True


def open(  # noqa: A001 (the verb of the command of that name)
    folder: str | Path = ".", *, port: int = 0, show: Callable[[str], object] | None = None
) -> Served:
    """Prepare the local page of a folder: its files, the set-up of a session, runs and reports.

    Parameters
    ----------
    folder : path-like
        With raw files, or a session already.
    port : int
        On which 127.0.0.1 answers; 0 takes a free one.
    show : callable, optional
        Given the address as soon as it answers, such as :func:`webbrowser.open`.

    Returns
    -------
    Served
        Its ``run()`` answers until Ctrl-C; ``address`` holds a random token that no other page knows.

    Raises
    ------
    SourceError
        There is no such folder.

    Examples
    --------
    >>> served = open("my-session")  # doctest: +SKIP
    >>> served.run()  # doctest: +SKIP
    """
    root = Path(folder)
    if not root.is_dir():
        raise SourceError(root, "there is no such folder", hint="Name the folder that holds the recordings.")
    answers = Answers(root.resolve())
    return _served(root, answers.application(), answers, port, show)


def open_guide(*, port: int = 0, show: Callable[[str], object] | None = None) -> Served:
    """Prepare the guide of the installed package as a local page, as :func:`open` does; no network is needed."""
    from pipelines.app._guide import application

    return _served(Path(), application(), None, port, show)


def _served(
    folder: Path, pages: Starlette, answers: Answers | None, port: int, show: Callable[[str], object] | None
) -> Served:
    import uvicorn

    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listening.bind((_HOST, port))
    listening.listen(64)  # a browser that is shown the address at once waits in the queue
    token, number = secrets.token_urlsafe(24), listening.getsockname()[1]
    app: Any = Guard(pages, token, number)
    config = uvicorn.Config(
        app, log_level="critical", access_log=False, lifespan="off", ws="none", http="h11", server_header=False
    )
    address = f"http://{_HOST}:{number}/{token}/"
    if show is not None:
        show(address)
    return Served(folder, address, answers, uvicorn.Server(config), listening)
