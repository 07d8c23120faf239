"""The actions of one component, whatever its ports do with them."""

from __future__ import annotations

from typing import Any

from ..contract.component import Port
from ..contract.interface import Verb
from ..runtime.ports import close_all
from .binding import Connected, Routes, Surroundings, connect, serve
from .client import ActionProxy, GoalClient
from .server import GoalServer


class Goals:
    """Binds actions, lets goals go on at each `compute`, and ends them."""

    def __init__(self, around: Surroundings) -> None:
        self._around = around
        self._servers: list[GoalServer] = []
        self._clients: list[GoalClient] = []

    def bind(self, port: Port, worker: Any, route: Routes) -> Connected:
        """Connect the actions of a port that is bound otherwise."""
        connected = Connected()
        try:
            if port.verb is Verb.REQUIRES:
                proxy: ActionProxy = getattr(worker, port.attribute)
                self._clients.append(connect(port, proxy, route, self._around, connected))
            else:
                self._servers += serve(port, worker, route, self._around, connected)
        except BaseException:
            close_all(connected.links)
            raise
        return connected

    def step(self) -> None:
        """Let each goal that is executed go on. Called inside the monitor, after `compute`."""
        for each in self._servers:
            each.step()

    def end(self) -> None:
        """End the goals that are executed here. Called inside the monitor, before `finish`."""
        for each in self._servers:
            each.end()

    def close(self) -> None:
        """Cancel the goals that this component has begun elsewhere, and end those here if `end` was not called."""
        for client in self._clients:
            client.close()
        for server in self._servers:
            server.end()
