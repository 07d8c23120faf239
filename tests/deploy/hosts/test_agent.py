"""The agent of another host, as those see it who come to it."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from robocomp_py.deploy.agent import Agent, Session, _tidy
from robocomp_py.deploy.hosts.lines import packed, told
from robocomp_py.deploy.process import Process
from robocomp_py.deploy.sockets import connected, listening
from robocomp_py.testing.patience import SOON

LASER = Process("laser", "Laser", (sys.executable, "-ISc", "import signal; signal.pause()"), Path("/"), notifies=False)


class Controller:
    """Says nothing by itself, not even that it is there."""

    def __init__(self, name: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._name, self._reader, self._writer = name, reader, writer

    def tell(self, **message: Any) -> None:
        self._writer.write(packed(message))

    def open(self) -> None:
        common = {"network": "Net", "command": "", "keep": False, "hosted": [], "names": ["laser"]}
        self.tell(do="open", controller=self._name, **common)

    async def is_told(self, *kinds: str) -> dict[str, Any]:
        """The first message of one of these kinds."""
        async with asyncio.timeout(SOON):
            while line := await self._reader.readline():
                message: dict[str, Any] = json.loads(line)
                if message["tell"] in kinds:
                    return message
        raise AssertionError(f"the agent has left without a word of {kinds}")

    async def leave(self) -> None:
        """And wait until that was noticed."""
        self._writer.write_eof()
        while await self._reader.read(65536):
            pass
        self._writer.close()


def scene(act: Callable[[Controller, Controller], Awaitable[object]]) -> None:
    """One controller has a process run, and another one wants to have the network run, too."""

    async def play() -> None:
        agent, (here, there) = Agent("Net"), socket.socketpair()
        agent.socket.parent.mkdir(parents=True)
        session = Session(*await asyncio.open_unix_connection(sock=there))
        running = asyncio.create_task(agent.run(session, listening(agent.socket)))
        first = Controller("first", *await asyncio.open_unix_connection(sock=here))
        first.open()
        await first.is_told("opened")
        first.tell(do="start", process=told(LASER, LASER.command, "/"))
        await first.is_told("started")
        second = Controller("second", *await asyncio.open_unix_connection(sock=connected(agent.socket, SOON)))
        second.open()
        async with asyncio.timeout(SOON):
            while not agent._heirs:
                await asyncio.sleep(0.002)
        await act(first, second)
        await running

    asyncio.run(play())


def test_who_comes_while_a_killed_controller_is_still_connected_takes_its_place(own_runtime_folder: Path):
    async def act(first: Controller, second: Controller) -> None:
        first.tell(do="alive")  # said before it was killed, and delivered only now
        await first.leave()
        assert (await second.is_told("opened", "refused")) == {"tell": "opened", "kept": []}
        await second.leave()

    scene(act)


def test_who_comes_while_a_killed_controller_says_nothing_takes_its_place(own_runtime_folder: Path):
    async def act(first: Controller, second: Controller) -> None:
        assert (await second.is_told("opened", "refused")) == {"tell": "opened", "kept": []}
        await first.leave()
        await second.leave()

    scene(act)


def test_who_comes_while_another_controller_is_in_touch_is_refused(own_runtime_folder: Path):
    async def act(first: Controller, second: Controller) -> None:
        first.tell(do="alive")
        assert "somebody else" in (await second.is_told("opened", "refused"))["why"]
        await second.leave()
        await first.leave()

    scene(act)


def test_who_ends_removes_nothing_of_an_agent_that_came_afterwards(tmp_path: Path):
    (tmp_path / "agent.log").touch()
    with listening(tmp_path / "agent"):
        _tidy(tmp_path / "agent")
    assert (tmp_path / "agent.log").exists()
    (tmp_path / "agent").unlink()
    _tidy(tmp_path / "agent")
    assert not tmp_path.exists()
