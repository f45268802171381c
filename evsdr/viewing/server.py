"""The page of a preview over HTTP, and what it shows over a websocket: for this machine, and for who knows the token."""

import hmac
import json
import logging
import secrets
import socket
import threading
import time
from html import escape
from http import HTTPStatus
from pathlib import Path

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from evsdr.page import document as report

HERE = Path(__file__).parent
HOST = "127.0.0.1"
STYLES = report.HERE / "style.css", HERE / "view.css", HERE / "preview.css"
SCRIPTS = (
    *(report.HERE / f"{name}.js" for name in ("colour", "charts")),
    *(HERE / f"{name}.js" for name in ("lines", "preview")),
)
SILENT = logging.getLogger("evsdr.viewing.server")
OPEN_S = 2.0  # for a request to come, once somebody has connected
LAST_S = 5.0  # for the last of what there is to show, on a busy machine
CLOSE_S = 1.0  # for a page to close


class Newest:
    """The newest of what there is to show; who is slow misses what was between."""

    def __init__(self):
        self._text, self._number, self._ended = "", 0, False
        self._news = threading.Condition()

    def put(self, text: str, ended: bool = False) -> None:
        """Replace what there is to show; nothing follows if it has ended."""
        with self._news:
            self._text, self._number, self._ended = text, self._number + 1, ended
            self._news.notify_all()

    def end(self) -> None:
        """Let nothing follow."""
        with self._news:
            self._ended = True
            self._news.notify_all()

    def after(self, number: int) -> tuple[str, int, bool]:
        """Wait for something newer; gives it, its number, and whether it is the last."""
        with self._news:
            self._news.wait_for(lambda: self._number > number or self._ended)
            return self._text, self._number, self._ended


class Server:
    """A page for this machine, as a context manager.

    Only 127.0.0.1 is listened on; the address holds a token, and a websocket must come from the page itself.

    Attributes
    ----------
    address : str
        Of the page.
    opened : threading.Event
        Set once a page is open.
    newest : Newest
        What it shows.
    """

    def __init__(self, title: str):
        self.newest, self.opened = Newest(), threading.Event()
        self._token, self._feeds = secrets.token_urlsafe(24), set()
        listener = socket.create_server((HOST, 0))
        self._place = f"{HOST}:{listener.getsockname()[1]}"
        self.address = f"http://{self._place}/{self._token}/"
        self._page = page(title, f"ws://{self._place}")
        SILENT.addHandler(logging.NullHandler())
        SILENT.propagate = False
        self._server = serve(
            self._feed,
            sock=listener,
            origins=[f"http://{self._place}"],
            process_request=self._answer,
            compression=None,
            max_size=1024,
            server_header=None,
            open_timeout=OPEN_S,
            close_timeout=CLOSE_S,
            logger=SILENT,
        )

    def __enter__(self) -> "Server":
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_) -> None:
        self.newest.end()
        end = time.monotonic() + LAST_S
        for feed in tuple(self._feeds):  # shutdown closes what is open, also before the last is sent
            feed.join(max(end - time.monotonic(), 0.0))
        self._server.shutdown()

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Refuse, or give the page; None lets a websocket go on, to have its origin checked."""
        _, token, *rest = (request.path + "/").split("/")
        known = hmac.compare_digest(token.encode(), self._token.encode())
        if not known or request.headers.get_all("Host") != [self._place]:
            return _response(
                HTTPStatus.FORBIDDEN, b"The address is not the one that evsdr.capture has printed.\n"
            )
        if rest[:1] == ["feed"]:
            return None
        if rest[:1] != [""]:
            return _response(HTTPStatus.NOT_FOUND, b"There is nothing here.\n")
        return _response(HTTPStatus.OK, self._page, "text/html; charset=utf-8")

    def _feed(self, connection: ServerConnection) -> None:
        """Send what is newest until there is nothing more."""
        self._feeds.add(threading.current_thread())
        self.opened.set()
        number, ended = 0, False
        while not ended:
            text, number, ended = self.newest.after(number)
            try:
                connection.send(text)
            except ConnectionClosed:
                return


def page(title: str, connect: str) -> bytes:
    """Give the page; it may connect to that address only."""
    parts = {"kind": "preview", "title": escape(title)}
    return report.assemble(HERE / "preview.html", STYLES, SCRIPTS, parts, {}, connect).encode("utf-8")


def text_of(values: dict) -> str:
    """Write what is to be shown as JSON."""
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def _response(status: HTTPStatus, body: bytes, kind: str = "text/plain; charset=utf-8") -> Response:
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Connection": "close",
            "Cache-Control": "no-store",
            "Content-Security-Policy": "frame-ancestors 'none'",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
    )
    return Response(status.value, status.phrase, headers, body)
