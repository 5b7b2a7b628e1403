"""The guide of the installed package as a local page."""

from __future__ import annotations

from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

_ASSETS = Path(__file__).parent / "assets"


def application() -> Starlette:
    """Return the application (ASGI)."""
    from pipelines.guide import FIRST, PICTURES, pages

    held = {f"{name}.html": (page.encode(), "text/html") for name, page in pages().items()}
    held |= {f"pictures/{path.name}": (path.read_bytes(), "image/webp") for path in PICTURES.glob("*.webp")}
    held["app.css"] = ((_ASSETS / "app.css").read_bytes(), "text/css")
    held["search.js"] = ((_ASSETS / "search.js").read_bytes(), "text/javascript")

    def answer(request: Request) -> Response:
        name = request.path_params["name"]
        if not name:
            return RedirectResponse(f"{FIRST}.html")
        return Response(held[name][0], media_type=held[name][1]) if name in held else Response("not found", 404)

    return Starlette(routes=[Route("/{name:path}", answer, methods=["GET"])])
