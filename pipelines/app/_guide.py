"""The guide of the installed package as a local page."""

from __future__ import annotations

from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

_STYLE = Path(__file__).parent / "assets/app.css"


def application() -> Starlette:
    """Return the application (ASGI)."""
    from pipelines.guide import FIRST, PICTURES, pages

    made = pages()
    pictures = {path.name: path for path in PICTURES.glob("*.webp")}

    def page(request: Request) -> Response:
        found = made.get(request.path_params["name"])
        return Response("not found", 404) if found is None else HTMLResponse(found)

    def first(request: Request) -> Response:
        del request
        return RedirectResponse(f"{FIRST}.html")

    def style(request: Request) -> Response:
        del request
        return Response(_STYLE.read_bytes(), media_type="text/css")

    def picture(request: Request) -> Response:
        found = pictures.get(request.path_params["name"])
        return Response("not found", 404) if found is None else Response(found.read_bytes(), media_type="image/webp")

    routes = [Route("/", first), Route("/app.css", style), Route("/pictures/{name}", picture)]
    routes.append(Route("/{name}.html", page))
    return Starlette(routes=[Route(route.path, route.endpoint, methods=["GET"]) for route in routes])
