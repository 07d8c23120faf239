"""Pyro5: the array travels beside the call, as an annotation, which Pyro does not serialise.

Serialised, arrays of a megabyte take several times as long. Over a Unix socket, with a thread for the
connection, and `marshal` for the rest of the call: of what Pyro offers, the quickest each.
"""

from __future__ import annotations

import time
from pathlib import Path
from threading import Thread

import numpy as np
import Pyro5
from Pyro5.api import Daemon, Proxy, current_context, expose

from .driver import Array, drive, main, until_told

Pyro5.config.SERIALIZER = "marshal"
Pyro5.config.SERVERTYPE = "thread"
_KEY = "ARRY"
_PATIENCE = 10.0


class Echo:
    @expose  # type: ignore[untyped-decorator]  # Pyro has no types
    def echo(self) -> None:
        asked: Array = np.frombuffer(current_context.annotations[_KEY], np.uint8)
        current_context.response_annotations = {_KEY: asked.data}


def far(folder: str) -> None:
    daemon = Daemon(unixsocket=_socket(folder))
    daemon.register(Echo(), "echo")
    loop = Thread(target=daemon.requestLoop, name="requests")
    loop.start()
    try:
        until_told()
    finally:
        daemon.shutdown()
        loop.join(_PATIENCE)


def near(folder: str) -> None:
    end = time.monotonic() + _PATIENCE
    while not Path(_socket(folder)).exists():
        if time.monotonic() > end:
            raise TimeoutError("the far end did not come")
        time.sleep(0.05)
    with Proxy(f"PYRO:echo@./u:{_socket(folder)}") as proxy:
        proxy._pyroBind()
        echo = proxy.echo  # looked up once, which is a little quicker

        def ask(data: Array) -> Array:
            current_context.annotations = {_KEY: data.data}
            echo()
            return np.frombuffer(current_context.response_annotations[_KEY], np.uint8)

        drive(ask, folder)


def _socket(folder: str) -> str:
    return f"{folder}/pyro.sock"


if __name__ == "__main__":
    main(far=far, near=near)
