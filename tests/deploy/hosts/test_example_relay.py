"""The relay of the example of a transport, in this process."""

from __future__ import annotations

import contextlib
import socket
import threading
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[3] / "examples" / "unixsock"


def test_a_relay_ends_while_another_one_sends_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLE))
    from unixsock_hosts import relaying

    asked = threading.Semaphore(0)

    def send(listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # the test has ended
            while True:
                connection, _ = listener.accept()
                with connection, contextlib.suppress(OSError):  # the relay has ended
                    connection.recv(9)
                    asked.release()
                    while True:
                        connection.sendall(b"[]\n" * 100)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        sender = threading.Thread(target=send, args=[listener])
        sender.start()
        peer = f"127.0.0.1:{listener.getsockname()[1]}"
        for _ in range(10):
            with relaying({"listen": "127.0.0.1:0", "peers": [peer], "channels": []}):
                asked.acquire()
        listener.shutdown(socket.SHUT_RDWR)
        sender.join()
