"""The server between a session and pages: HTTP for the page, a WebSocket for messages.

It listens on the loopback interface alone, and every address begins with a random token. A page of
another site that guesses both is refused still, by its `Host` (a name that was bound to 127.0.0.1
afterwards) or its `Origin`.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import secrets
import threading
from collections.abc import Callable
from importlib import resources
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from furcl.errors import FurclError, SceneError
from furcl.viewer import telling
from furcl.viewer.downloads import download
from furcl.viewer.messages import decode
from furcl.viewer.session import Session
from furcl.viewer.telling import Kind

log = logging.getLogger(__name__)

HOST = "127.0.0.1"
MOST_MESSAGE_BYTES = 1 << 16
TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
# Notebooks show the page in a frame.
SAFE_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; "
    "frame-ancestors 'self' http://127.0.0.1:* http://localhost:*",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class ViewServer:
    """Serves a session from a thread of its own.

    Parameters
    ----------
    session : Session
    port : int              0: one that is free

    Attributes
    ----------
    address : str           of the page

    Raises
    ------
    SceneError              the port cannot be listened on
    """

    def __init__(self, session: Session, port: int = 0) -> None:
        self._session = session
        self._token = secrets.token_urlsafe(24)
        self._loop = asyncio.new_event_loop()
        self._server: Server | None = None
        self._stop: asyncio.Event | None = None
        self._failure: OSError | None = None
        ready = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(port, ready), name="view server", daemon=True
        )
        self._thread.start()
        ready.wait()
        if self._failure:
            raise SceneError(
                f"port {port} cannot be listened on: {self._failure.strerror}; give another "
                f"--port, or none for one that is free"
            )
        self.port = self._port()
        self.address = f"http://{HOST}:{self.port}/{self._token}/"

    def close(self) -> None:
        """Close all connections and end the thread."""
        if self._thread.is_alive():
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._set_stop)
            self._thread.join()

    def _set_stop(self) -> None:
        assert self._stop is not None
        self._stop.set()

    def _port(self) -> int:
        assert self._server is not None
        return next(iter(self._server.sockets)).getsockname()[1]

    def _run(self, port: int, ready: threading.Event) -> None:
        try:
            self._loop.run_until_complete(self._serve(port, ready))
        finally:
            self._loop.close()

    async def _serve(self, port: int, ready: threading.Event) -> None:
        self._stop = asyncio.Event()
        quiet = log.getChild("connections")
        quiet.setLevel(logging.CRITICAL)
        try:
            self._server = await serve(
                self._talk,
                HOST,
                port,
                process_request=self._answer,
                max_size=MOST_MESSAGE_BYTES,
                compression=None,
                logger=quiet,
                server_header=None,
            )
        except OSError as error:
            self._failure = error
            ready.set()
            return
        ready.set()
        async with self._server:
            await self._stop.wait()

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """What a request gets; None: the WebSocket that it asks for."""
        hosts = {f"{HOST}:{self._port()}", f"localhost:{self._port()}"}
        host, origin = request.headers.get("Host"), request.headers.get("Origin")
        if host not in hosts or (origin is not None and origin.partition("://")[2] != host):
            return _response(403, "this page is of this machine only\n")
        token, _, name = request.path.lstrip("/").partition("?")[0].partition("/")
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return _response(404, "there is nothing here: the address is not complete\n")
        upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        if name == "socket" and upgrade:
            return None if origin else _response(403, "a page says its origin\n")
        if upgrade:
            return _response(404, "there is no socket of that name\n")
        try:
            return await self._file(name or "index.html")
        except FurclError as error:
            return _response(409, f"{error}\n")

    async def _file(self, name: str) -> Response:
        found = await download(self._session, name)
        if found:
            body, kind, called = found
            disposition = f'attachment; filename="{called}"'
            return _response(200, body, kind, {"Content-Disposition": disposition})
        ending = name.rpartition(".")[2]
        file = resources.files("furcl.viewer") / "page" / name
        if ending not in TYPES or "/" in name or not file.is_file():
            return _response(404, f"there is no {name}\n")
        return _response(200, file.read_bytes(), TYPES[ending])

    async def _talk(self, connection: ServerConnection) -> None:
        """One page: messages to it, the last of each kind, and from it."""
        outbox = _Outbox(asyncio.get_running_loop())
        sender = asyncio.create_task(outbox.send_to(connection))
        self._session.listen(outbox.put)
        try:
            async for message in connection:
                try:
                    self._session.ask(decode(message), outbox.put)
                except FurclError as error:
                    outbox.put("error", telling.error(error))
        except ConnectionClosed:
            pass
        finally:
            self._session.forget(outbox.put)
            sender.cancel()


class _Outbox:
    """Messages that a page is to get; one that comes before the last of its kind was sent takes its
    place, so that a slow page lags behind nothing."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: dict[Any, str | bytes] = {}
        self._filled = asyncio.Event()
        # One listener, however often it is asked for.
        self.put: Callable[[Kind, str | bytes], None] = self._put

    def _put(self, kind: Kind, message: str | bytes) -> None:
        """From any thread."""
        self._loop.call_soon_threadsafe(self._take, kind, message)

    def _take(self, kind: Kind, message: str | bytes) -> None:
        self._waiting.pop(kind, None)
        self._waiting[kind] = message
        self._filled.set()

    async def send_to(self, connection: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                await self._filled.wait()
                self._filled.clear()
                while self._waiting:
                    kind = next(iter(self._waiting))
                    await connection.send(self._waiting.pop(kind))


def _response(
    status: int,
    body: str | bytes,
    kind: str = "text/plain; charset=utf-8",
    more: dict[str, str] | None = None,
) -> Response:
    content = body.encode() if isinstance(body, str) else body
    reasons = {200: "OK", 403: "Forbidden", 404: "Not Found", 409: "Conflict"}
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Connection": "close",
            **SAFE_HEADERS,
            **(more or {}),
        }
    )
    return Response(status, reasons[status], headers, content)
