"""A TCP proxy before a real server, whose faults a test chooses while requests go through it."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress

from tests.helpers.limits import PATIENCE
from tests.helpers.ports import free_port

SLOW_SECONDS = 1.5  # per answer: a store that nobody should wait for
ONCE = ("swallow", "cut", "late")


class Proxy:
    """Listens on `port`, and treats what comes by its mode.

    open: passes everything; refuse: nobody listens; hang: takes requests and answers none; slow: answers late.
    Once, for the first request that has `mark`, and open for all others: swallow: the server does it, its answer is
    lost; cut: its answer breaks off; late: the server gets it when `release` is set, after the client gave up.
    """

    def __init__(self, target: int) -> None:
        self.port = free_port()
        self.hits = 0
        self.release = threading.Event()
        self._target = target
        self._mode, self._mark = "refuse", b""
        self._sockets: list[socket.socket] = []
        self._listener: socket.socket | None = None
        self.set("open")

    @property
    def uri(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def set(self, mode: str, mark: bytes = b"") -> None:
        """Change the mode. Connections are cut, so that none goes on in the old one."""
        self._mode, self._mark = mode, mark
        for connection in [*self._sockets]:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        self._sockets.clear()
        if mode == "refuse" and self._listener is not None:
            listener, self._listener = self._listener, None
            listener.shutdown(socket.SHUT_RDWR)
            listener.close()
        elif mode != "refuse" and self._listener is None:
            self._listener = socket.create_server(("127.0.0.1", self.port), backlog=64)
            threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            self._sockets.append(client)
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        """One connection: requests to the server, and a thread for the answers."""
        faults: list[str] = []
        with client, suppress(OSError), socket.create_connection(("127.0.0.1", self._target)) as server:
            threading.Thread(target=self._answer, args=(server, client, faults), daemon=True).start()
            while data := client.recv(65536):
                if self._mode == "refuse":  # it was accepted while the mode changed
                    return
                if self._mode in ONCE and self._mark in data:
                    faults.append(self._mode)
                    self._mode = "open"
                    self.hits += 1
                if "late" in faults:
                    self._send_late(client, data)
                elif self._mode != "hang":
                    server.sendall(data)

    def _send_late(self, client: socket.socket, data: bytes) -> None:
        while more := client.recv(65536):  # until the client gives up
            data += more
        self.release.wait(PATIENCE)
        with socket.create_connection(("127.0.0.1", self._target)) as server:
            server.sendall(data)
            server.recv(65536)

    def _answer(self, server: socket.socket, client: socket.socket, faults: list[str]) -> None:
        with suppress(OSError):
            while data := server.recv(65536):
                if self._mode == "slow":
                    time.sleep(SLOW_SECONDS)
                if "swallow" in faults:
                    break
                if "cut" in faults:
                    client.sendall(data[: len(data) // 2])
                    break
                client.sendall(data)
        if "late" not in faults:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
