"""Serves the page that shows a COPC file by level to the browser of this machine, and to nobody else.

Only this machine can connect. A page of another site cannot read anything: it does not know the token in the path, and
a name of its own that leads here is refused, as the browser tells which host it asked for.
"""

import re
import secrets
import sys
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any

from gppcs.drawing.web.levels import Levels
from gppcs.errors import GppcsError


class LevelsServer(ThreadingTCPServer):
    """Answers at a free port of the loopback address, under a path that nobody can guess."""

    daemon_threads = True  # a browser that keeps its connection does not keep the program

    def __init__(self, levels: Levels) -> None:
        self.levels, self.token = levels, secrets.token_urlsafe(16)
        super().__init__(("127.0.0.1", 0), _Handler)
        self.host = f"127.0.0.1:{self.server_address[1]}"
        self.url = f"http://{self.host}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that has closed its connection, or takes nothing more."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: LevelsServer
    protocol_version = "HTTP/1.1"  # which keeps the connection
    timeout = 60  # seconds that a silent connection holds a thread
    server_version, sys_version = "gppcs", ""

    def do_GET(self) -> None:
        """Answer with the page, or with a node."""
        token, slash, rest = self.path.removeprefix("/").partition("/")
        if self.headers.get_all("Host") != [self.server.host]:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
        elif not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif slash and not rest:  # without the slash, the page would ask for its nodes elsewhere
            self._send(self.server.levels.page, "text/html; charset=utf-8")
        elif re.fullmatch("[0-9]{1,9}", rest) and int(rest) < len(self.server.levels):
            self._send_node(int(rest))
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _send_node(self, number: int) -> None:
        try:
            content = self.server.levels.node(number)
        except (GppcsError, OSError) as error:
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR, explain=str(error))
        else:
            self._send(content, "application/octet-stream")

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        with suppress(ConnectionError, TimeoutError):  # the browser no longer wants it
            self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """Print nothing of each request."""
