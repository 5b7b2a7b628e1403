"""Who may ask: requests under the token, of this host, from this page, and of a bounded size."""

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse

_MOST_BYTES = 1_000_000
"""Of the body of a request; no change to a session is longer."""

#: The page takes scripts, styles and pictures from this address, and nothing from anywhere else.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: A report brings all it needs and states its own policy; only this page may show it.
REPORT_POLICY = "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[MutableMapping[str, Any], Receive, Send], Awaitable[None]]


class Guard:
    """Refuses requests that do not come from the page itself.

    ``app`` answers (ASGI) and sees addresses without the ``token``, the first part of each; ``port`` is this server's.
    """

    def __init__(self, app: App, token: str, port: int) -> None:
        self.app = app
        self.token = token
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Answer a request, or say why not."""
        if scope["type"] != "http":
            return
        if (problem := self._problem(scope)) is not None:
            await PlainTextResponse(problem[1], problem[0], headers=dict(_COMMON))(scope, receive, send)
            return
        path = scope["path"].removeprefix(f"/{self.token}")
        inner = dict(scope) | {"path": path, "raw_path": path.encode(), "root_path": ""}
        policy = REPORT_POLICY if path.startswith("/reports/") else POLICY
        headers = [(k.encode(), v.encode()) for k, v in (*_COMMON, ("content-security-policy", policy))]

        taken = 0

        async def receive_bounded() -> Message:
            """Cut a body off that is longer than it may be, whatever length it stated."""
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            return {"type": "http.disconnect"} if taken > _MOST_BYTES else message

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *headers]
            await send(message)

        await self.app(inner, receive_bounded, send_guarded)

    def _problem(self, scope: MutableMapping[str, Any]) -> tuple[int, str] | None:
        """Return the status and the reason of a refusal."""
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self.hosts:
            return 403, "this page answers to 127.0.0.1 only"
        first = scope["path"].split("/")[1] if "/" in scope["path"] else ""
        if not secrets.compare_digest(first.encode(), self.token.encode()):
            return 404, "not found"
        if scope["method"] not in ("GET", "POST"):
            return 405, "this is not done here"
        is_own = origin is not None and origin.removeprefix("http://") in self.hosts and origin.startswith("http://")
        if not is_own and (origin is not None or scope["method"] == "POST"):
            return 403, "another page may not ask"
        if scope["method"] == "POST" and headers.get("content-type", "").split(";")[0] != "application/json":
            return 415, "expected JSON"
        if not headers.get("content-length", "0").isdecimal() or int(headers.get("content-length", "0")) > _MOST_BYTES:
            return 413, "too long"
        return None


_COMMON = (
    ("cache-control", "no-store"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("cross-origin-resource-policy", "same-origin"),
)
