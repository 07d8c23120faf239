"""The commands for one host, with few starts at a time.

A start may take long, for instance over a network. A process that is stopped before its turn is not started at all.
"""

from __future__ import annotations

import asyncio
import signal
from collections import deque
from collections.abc import Callable

from ..errors import DeploymentError
from .agents import Abandoned, Agent, Listener
from .process import Process

CANNOT_BE_STARTED = 127
"""The exit code for a process that could not be started, as in shells."""

ABREAST = 8
"""Maximum number of simultaneous starts on this machine, where the fork server makes them cheap. The agent of another
host carries out one command at a time, and a command that was sent cannot be taken back.
"""


class HostCommands:
    """The commands for one agent; `run` carries out the starts."""

    def __init__(self, agent: Agent, listener: Listener) -> None:
        self.agent, self._listener = agent, listener
        self._starts: deque[Process] = deque()
        self._news = asyncio.Event()

    def start(self, process: Process) -> None:
        self._starts.append(process)
        self._news.set()

    def stop(self, name: str) -> None:
        self._end(name, self.agent.stop)

    def kill(self, name: str) -> None:
        self._end(name, self.agent.kill)

    def forget(self) -> None:
        """Drop the starts that wait: the host is out of reach."""
        self._starts.clear()

    async def run(self) -> None:
        """For ever, until cancelled: one start after the other. Several of these may run at a time."""
        while True:
            await self._news.wait()
            while self._starts:
                await self._start(self._starts.popleft())
            self._news.clear()

    async def _start(self, process: Process) -> None:
        try:
            await self.agent.start(process)
        except Abandoned:
            self._listener.exited(process.name, -signal.SIGTERM)
        except DeploymentError as exc:
            self._listener.output(process.name, str(exc))
            self._listener.exited(process.name, CANNOT_BE_STARTED)

    def _end(self, name: str, deed: Callable[[str], None]) -> None:
        waiting = next((each for each in self._starts if each.name == name), None)
        if waiting:
            self._starts.remove(waiting)
            self._listener.exited(name, -signal.SIGTERM)
        else:
            deed(name)
