"""A real HTTP proxy, as `http_proxy` names one, which spoils what it passes on."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

_NOT_PASSED_ON = {"transfer-encoding", "connection", "content-length"}


@dataclass(frozen=True)
class Answer:
    """Hold an answer on its way to the robot."""

    status: int
    headers: Mapping[str, str]
    body: bytes


@dataclass
class Proxy:
    """Hold a proxy: what it does to answers, and the requests that it has seen.

    Parameters
    ----------
    url : str
        Where it listens.
    spoil : callable
        Takes a request's address, its headers and the service's answer; gives what the robot gets.
    seen : list
        The addresses that were asked for.
    """

    url: str
    spoil: Callable[[str, Mapping[str, str], Answer], Answer] = lambda _path, _asked, answer: answer
    seen: list[str] = field(default_factory=list)


@contextmanager
def proxied() -> Iterator[Proxy]:
    """Give a proxy, which is honest until its `spoil` is set."""
    proxy = Proxy("")

    class Handler(BaseHTTPRequestHandler):
        def _pass_on(self) -> None:
            proxy.seen.append(self.path)
            asked, wanted = dict(self.headers.items()), urlsplit(self.path)
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            line = http.client.HTTPConnection(wanted.netloc, timeout=60)
            line.request(self.command, f"{wanted.path}?{wanted.query}", body or None, asked)
            told = line.getresponse()
            answer = Answer(told.status, dict(told.getheaders()), told.read())
            line.close()
            length = answer.headers.get("content-length", "0")
            spoilt = proxy.spoil(self.path, asked, answer)
            self.send_response(spoilt.status)
            for name, value in spoilt.headers.items():
                if name.lower() not in _NOT_PASSED_ON:
                    self.send_header(name, value)
            is_as_long = self.command == "HEAD" and spoilt is answer
            self.send_header("Content-Length", length if is_as_long else str(len(spoilt.body)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(spoilt.body)

        do_GET = do_HEAD = do_POST = _pass_on  # noqa: N815 - the names of the standard library

        def log_message(self, *_args: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        proxy.url = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            yield proxy
        finally:
            server.shutdown()
            thread.join()


def page(status: int, text: str, **headers: str) -> Callable[[str, Mapping[str, str], Answer], Answer]:
    """Return what answers every request by a page of its own."""
    own = Answer(status, {"Content-Type": "text/html", **headers}, text.encode())
    return lambda _path, _asked, _answer: own


def on_files(change: Callable[[bytes], bytes]) -> Callable[[str, Mapping[str, str], Answer], Answer]:
    """Return what changes the bytes of files, and of nothing else."""

    def spoil(path: str, _asked: Mapping[str, str], answer: Answer) -> Answer:
        is_file = ("/artifacts/" in path or "/delta" in path) and answer.status < 300
        return replace(answer, body=change(answer.body)) if is_file and answer.body else answer

    return spoil
