"""The requests of the page, and the answers to them."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from labpipe.errors import InputError, LabpipeError
from labpipe.files import files_below, safe_join
from labpipe.report import Picture, plus_minus
from labpipe.workflow.session import FILE_NAME
from pipelines.app import _history as history, _measuring as measuring, _setup as setup
from pipelines.app._film import watched
from pipelines.app._outlook import outlook
from pipelines.app._pictures import small_picture
from pipelines.app._runs import Runs
from pipelines.session import Surveyed, draft

if TYPE_CHECKING:
    from pipelines.experiments.shared.film_frames import DrawnFilm

_ASSETS = Path(__file__).parent / "assets"
_TYPES = {".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".svg": "image/svg+xml"}
_NAMES = ("app.js", "setup.js", "measure.js", "film.js", "app.css")
Told = dict[str, Any]


class Answers:
    """Answers of the page of one folder, which is resolved; nothing outside it is shown."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.runs = Runs(folder)
        self._films: dict[Path, tuple[DrawnFilm, str]] = {}
        self._watching = threading.Lock()
        self._writing = threading.Lock()
        self._surveyed: tuple[object, list[Surveyed]] = (None, [])
        self._drafted: tuple[object, dict[str, str]] = (None, {})

    def application(self) -> Starlette:
        """Return the application (ASGI)."""
        gets: dict[str, Callable[[Request], Response]] = {
            "/": lambda request: _asset("app.html"),
            "/assets/{name}": lambda request: _asset(request.path_params["name"], _NAMES),
            "/reports/{name:path}": self._report,
            "/api/picture": lambda request: Response(small_picture(self._named(request)), media_type="image/png"),
            "/api/frame": lambda request: Response(self._image(request).png(), media_type="image/png"),
            "/api/image": lambda request: JSONResponse({"frames": self._image(request).frames}),
            "/api/film": lambda request: JSONResponse(self._film(request)),
            "/api/files": lambda request: JSONResponse(self.files()),
            "/api/run": lambda request: JSONResponse(self.runs.state(_number(request, "after"))),
            "/api/session": lambda request: JSONResponse(self.session()),
            "/api/plan": lambda request: JSONResponse(outlook(self.folder, self._survey())),
        }
        posts: dict[str, Callable[[Told], Told]] = {
            "/api/run": self.run,
            "/api/check": self.check,
            "/api/write": self.write,
            "/api/length": self.length,
            "/api/beside": self.beside,
        }
        routes = [Route(path, _guarded(answer), methods=["GET"]) for path, answer in gets.items()]
        return Starlette(routes=[*routes, *(Route(path, _asked(a), methods=["POST"]) for path, a in posts.items())])

    # --- files ---

    def files(self) -> Told:
        """List the files of the folder, and the pages that there are."""
        made = self.folder / "labpipe"
        pages = sorted(p.relative_to(made).as_posix() for at in ("", "reports/") for p in made.glob(f"{at}*.html"))
        return {
            "folder": self.folder.name,
            "is_session": (self.folder / FILE_NAME).is_file(),
            "files": [entry._asdict() for entry in self._survey()],
            "pages": pages,
        }

    def _survey(self) -> list[Surveyed]:
        """Look at the files again only when one is new, gone or changed: the page asks every second."""
        from pipelines.session import survey

        made = self.folder / "labpipe"
        states = ((p, p.stat()) for p in files_below(self.folder) if not p.is_relative_to(made))
        seen = tuple((p, state.st_size, state.st_mtime_ns) for p, state in states)
        if seen != self._surveyed[0]:
            self._surveyed = (seen, survey(self.folder))
        return self._surveyed[1]

    def path(self, name: object) -> Path:
        """Return where a file of the folder is, and refuse paths outside it and missing files."""
        if not isinstance(name, str):
            raise InputError("expected the name of a file")
        path = safe_join(self.folder, name)
        if not path.exists():
            raise InputError(f'there is no file "{name}"')
        return path

    def _named(self, request: Request) -> Path:
        return self.path(request.query_params.get("name"))

    def _image(self, request: Request) -> measuring.Picture:
        return measuring.picture(self._named(request), _number(request, "index"))

    def _film(self, request: Request) -> Told:
        """Open a film with the results as they are now; with an ``index``, return that frame of it."""
        from pipelines.experiments.shared.film_frames import jpeg

        path, asked = self._named(request), request.query_params
        # warnings of a film are shown where it is inspected or processed
        with self._watching, warnings.catch_warnings(action="ignore"):
            if "index" not in asked or path not in self._films:
                self._films[path] = watched(self.folder, path)
            film, experiment = self._films[path]
            if "index" not in asked:
                return {"frames": len(film.source), "jumps": dict(film.jumps), "experiment": experiment}
            image, caption = film.shown(_number(request, "index"), asked.get("drawn") != "0")
            return {"image": "" if image is None else Picture(jpeg(image), caption).address, "caption": caption}

    def length(self, asked: Told) -> Told:
        """Measure between two clicks in a picture or a frame."""
        try:
            first, second = (tuple(map(float, point)) for point in asked["points"])
            index = int(asked.get("index", 0))
            (x1, y1), (x2, y2) = first, second
        except (KeyError, TypeError, ValueError):
            raise InputError("expected two points of x and y") from None
        grey = measuring.picture(self.path(asked.get("name")), index).grey
        found = measuring.length(grey, (x1, y1), (x2, y2))
        return {"points": found.points, "text": f"{plus_minus(found.value, found.u)} px", "found": found.found}

    def _report(self, request: Request) -> Response:
        path = self.path(f"labpipe/{request.path_params['name']}")
        if path.suffix != ".html" or not path.is_file() or not path.is_relative_to(self.folder / "labpipe"):
            raise InputError("only reports are shown here")
        return FileResponse(path, media_type="text/html")

    # --- the session ---

    def session(self) -> Told:
        """Return the set-up as it is; where there is none, as it is proposed."""
        texts = setup.read(self.folder)
        asked = [] if FILE_NAME in texts else [{"op": "propose"}]
        return self._state(texts, setup.changed(self.folder, texts, asked, self._draft)) | {"edits": asked}

    def check(self, asked: Told) -> Told:
        """Return the set-up as changes would make it, with the difference; nothing is written."""
        return self._state(*self._changed(asked))

    def write(self, asked: Told) -> Told:
        """Write changes that were looked at, unless the files are others by now."""
        with self._writing:
            written = history.write(self.folder, *self._changed(asked))
        return self.session() | {"written": written}

    def _state(self, texts: dict[str, str], new: dict[str, str]) -> Told:
        told = {"base": setup.digest(texts), "versions": history.versions(self.folder)}
        told |= {"difference": history.difference(texts, new), "words": history.in_words(texts, new)}
        return setup.state(self.folder, {FILE_NAME: ""} | new) | told

    def _draft(self) -> dict[str, str]:
        """Propose a session; again only when a file is new, gone or changed."""
        self._survey()
        if self._drafted[0] != self._surveyed[0]:
            self._drafted = (self._surveyed[0], draft(self.folder).texts)
        return self._drafted[1]

    def beside(self, asked: Told) -> Told:
        """Write the page of two experiments side by side."""
        from pipelines.session import beside

        with self._writing:
            page = beside(self.folder, str(asked.get("first")), str(asked.get("second")))
        return {"page": page.name}

    def _changed(self, asked: Told) -> tuple[dict[str, str], dict[str, str]]:
        texts = setup.read(self.folder)
        if asked.get("base") != setup.digest(texts):
            raise InputError(
                "the files were changed elsewhere meanwhile; the set-up is read again, your last changes are not in it"
            )
        return texts, setup.changed(self.folder, texts, asked.get("edits"), self._draft)

    def run(self, asked: Told) -> Told:
        """Begin a run, watch, or stop."""
        action = asked.get("action")
        if action == "stop":
            self.runs.stop()
        elif action in ("process", "watch"):
            self.runs.start(action)
        else:
            raise InputError(f"expected process, watch or stop, found {action!r}")
        return self.runs.state()


def _asset(name: str, allowed: tuple[str, ...] = ("app.html",)) -> Response:
    if name not in allowed:
        return Response("not found", 404)
    path = _ASSETS / name
    return Response(path.read_bytes(), media_type=_TYPES[path.suffix])


def _number(request: Request, name: str) -> int:
    text = request.query_params.get(name, "0")
    return int(text) if text.isdecimal() and len(text) < 10 else 0


def _refused(error: LabpipeError) -> Response:
    return JSONResponse({"error": str(error), "problems": list(getattr(error, "problems", ()))}, 400)


def _guarded(answer: Callable[[Request], Response]) -> Callable[[Request], Response]:
    """Report errors instead of failing."""

    def answered(request: Request) -> Response:
        try:
            return answer(request)
        except LabpipeError as error:
            return _refused(error)
        except OSError as error:
            return _refused(InputError(f"{error.strerror or error}"))

    return answered


def _asked(answer: Callable[[Told], Told]) -> Any:
    """Read the JSON of a request, and answer it in parallel with the others."""
    from starlette.concurrency import run_in_threadpool

    async def answered(request: Request) -> Response:
        try:
            asked = await request.json()
        except (ValueError, RecursionError):
            asked = None
        if not isinstance(asked, dict):
            return _refused(InputError("expected one JSON object"))
        return await run_in_threadpool(_guarded(lambda _: JSONResponse(answer(asked))), request)

    return answered
