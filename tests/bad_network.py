"""A network as in a plant: a TCP proxy that is slow, and lets every connection fall now and then."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

_PIECE = 16 * 1024
_TICK_S = 0.02


class BadNetwork:
    """Hold a proxy before a service.

    Parameters
    ----------
    url : str
        Of the service.
    rate : float
        Bytes a second that all connections together send to the service; it may be changed.
    cut_every : int, optional
        After so many bytes sent to the service all connections fall, again and again. Bytes and not seconds:
        a file of more than so many meets a cut on a machine of any speed.
    """

    def __init__(self, url: str, *, rate: float, cut_every: int | None = None) -> None:
        self._service = (str(urlsplit(url).hostname), int(urlsplit(url).port or 80))
        self.rate, self._cut_every = rate, cut_every
        self._door = socket.create_server(("127.0.0.1", 0))
        self._lock = threading.Lock()
        self._lines: set[socket.socket] = set()
        self._over = threading.Event()
        self.url = f"http://127.0.0.1:{self._door.getsockname()[1]}"
        self.sent = 0
        self.cuts = 0

    def cut(self) -> None:
        """Let every connection fall, as when the tablet leaves the Wi-Fi's reach."""
        with self._lock:
            fallen, self._lines = self._lines, set()
            self.cuts += bool(fallen)
        for line in fallen:
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)

    def serve(self) -> None:
        """Accept connections until `close`."""
        while not self._over.is_set():
            try:
                near, _ = self._door.accept()
            except OSError:
                return
            threading.Thread(target=self._carry, args=(near,), daemon=True).start()

    def close(self) -> None:
        """Let everything fall and accept no more."""
        self._over.set()
        with contextlib.suppress(OSError):
            self._door.shutdown(socket.SHUT_RDWR)
        self._door.close()
        self.cut()

    def _carry(self, near: socket.socket) -> None:
        with near, contextlib.suppress(OSError), socket.create_connection(self._service) as far:
            with self._lock:
                self._lines |= {near, far}
            try:
                self._both_ways(near, far)
            finally:
                with self._lock:
                    self._lines -= {near, far}

    def _both_ways(self, near: socket.socket, far: socket.socket) -> None:
        with selectors.DefaultSelector() as ready:
            ready.register(near, selectors.EVENT_READ, far)
            ready.register(far, selectors.EVENT_READ, near)
            while True:
                for key, _ in ready.select():
                    line: socket.socket = key.fileobj  # type: ignore[assignment]  # what was registered
                    piece = line.recv(_PIECE)
                    if not piece:
                        return
                    key.data.sendall(piece)
                    if line is near:
                        self._wait_for(len(piece))

    def _wait_for(self, size: int) -> None:
        with self._lock:
            before, self.sent = self.sent, self.sent + size
        if self._cut_every and before // self._cut_every < self.sent // self._cut_every:
            self.cut()
        if size > _PIECE * _TICK_S:
            time.sleep(size / self.rate)


@contextlib.contextmanager
def bad_network(url: str, *, rate: float, cut_every: int | None = None) -> Iterator[BadNetwork]:
    """Give a slow and unreliable way to a service."""
    network = BadNetwork(url, rate=rate, cut_every=cut_every)
    thread = threading.Thread(target=network.serve)
    thread.start()
    try:
        yield network
    finally:
        network.close()
        thread.join()
