"""The agent of another host, as those see it who come to it."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.deploy.agent import Agent, Session, _connected_to, _tidy
from robocomp_py.deploy.hosts.lines import Message, packed, told
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

    def open(self, hosted: Sequence[tuple[str, dict[str, Any]]] = ()) -> None:
        common = {"network": "Net", "command": "", "keep": False, "hosted": hosted, "names": ["laser"]}
        self.tell(do="open", controller=self._name, **common)

    async def is_told(self, *kinds: str) -> dict[str, Any]:
        """The first message of one of these kinds."""
        async with asyncio.timeout(SOON * 3):  # noticing silence takes a while
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


async def run_by_first(
    agent: Agent, hosted: Sequence[tuple[str, dict[str, Any]]] = ()
) -> tuple[asyncio.Task[None], Controller]:
    """The agent, at work, and who asks it to be."""
    here, there = socket.socketpair()
    agent.socket.parent.mkdir(parents=True)
    session = Session(*await asyncio.open_unix_connection(sock=there))
    running = asyncio.create_task(agent.run(session, listening(agent.socket)))
    first = Controller("first", *await asyncio.open_unix_connection(sock=here))
    first.open(hosted)
    return running, first


def scene(act: Callable[[Controller, Controller], Awaitable[object]]) -> None:
    """One controller has a process run, and another one wants to have the network run, too."""

    async def play() -> None:
        agent = Agent("Net")
        running, first = await run_by_first(agent)
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


def test_a_new_controller_replaces_a_killed_one_that_is_still_connected(own_runtime_folder: Path):
    async def act(first: Controller, second: Controller) -> None:
        first.tell(do="alive")  # said before it was killed, and delivered only now
        await first.leave()
        assert (await second.is_told("opened", "refused")) == {"tell": "opened", "kept": []}
        await second.leave()

    scene(act)


def test_a_new_controller_replaces_a_killed_one_that_is_silent(own_runtime_folder: Path):
    async def act(first: Controller, second: Controller) -> None:
        assert (await second.is_told("opened", "refused")) == {"tell": "opened", "kept": []}
        await first.leave()
        await second.leave()

    scene(act)


def test_a_second_controller_is_refused_while_the_first_is_alive(own_runtime_folder: Path):
    async def act(first: Controller, second: Controller) -> None:
        first.tell(do="alive")
        assert "another controller" in (await second.is_told("opened", "refused"))["why"]
        await second.leave()
        await first.leave()

    scene(act)


def test_a_controller_that_took_over_is_not_ended_with_its_predecessor(own_runtime_folder: Path):
    async def play() -> None:
        agent = Agent("Net")
        running, first = await run_by_first(agent)
        await first.is_told("opened")
        await agent._alone()  # begins when a controller is lost, and may still run when the next one is there
        assert not agent._ending
        await first.leave()
        await running

    asyncio.run(play())


class Slow(Agent):
    """Takes its time to begin."""

    async def _begin(self, message: Message) -> None:
        self.may_begin = asyncio.Event()
        await self.may_begin.wait()
        await super()._begin(message)


def test_a_controller_may_be_silent_while_the_network_starts(own_runtime_folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("robocomp_py.deploy.agent.BEAT", 0.01)
    monkeypatch.setattr("robocomp_py.deploy.agent.SILENCE", 0.0)

    async def play() -> None:
        agent = Slow("Net")
        running, first = await run_by_first(agent)
        for _ in range(3):
            await first.is_told("usage")
        agent.may_begin.set()
        await first.is_told("opened")
        await first.leave()
        await running

    asyncio.run(play())


def test_a_router_that_does_not_start_is_reported_and_the_agent_ends(
    own_runtime_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    may_end, ended = threading.Event(), threading.Event()

    @contextmanager
    def hanging(*_: object) -> Iterator[None]:
        may_end.wait(SOON)
        yield
        ended.set()

    monkeypatch.setattr("robocomp_py.transports.base.hosting", hanging)
    monkeypatch.setattr("robocomp_py.deploy.agent.HOSTING_TIMEOUT", 0.01)

    async def play() -> None:
        running, first = await run_by_first(Agent("Net"), hosted=[("relayed", {})])
        why = (await first.is_told("refused"))["why"]
        assert why == "what relayed shares there has not started within 0.01 s"
        await first.leave()
        await running

    asyncio.run(play())
    may_end.set()
    assert ended.wait(SOON), "a router that starts after the agent has given up ends at once"


def test_an_agent_that_was_stopped_itself_does_not_count_its_controller_as_gone(
    own_runtime_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("robocomp_py.deploy.agent.BEAT", 0.05)
    clock = time.monotonic

    async def play() -> None:
        running, first = await run_by_first(Agent("Net"))
        await first.is_told("opened")
        await first.is_told("usage")
        monkeypatch.setattr(time, "monotonic", lambda: clock() + 1000)
        for _ in range(3):
            await first.is_told("usage")
        await first.leave()
        await running

    asyncio.run(play())


def test_an_ending_agent_removes_no_file_of_its_successor(tmp_path: Path):
    (tmp_path / "agent.log").touch()
    with listening(tmp_path / "agent"):
        _tidy(tmp_path / "agent")
    assert (tmp_path / "agent.log").exists()
    (tmp_path / "agent").unlink()
    _tidy(tmp_path / "agent")
    assert not tmp_path.exists()


def test_a_busy_agent_is_not_taken_for_a_missing_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocomp_py.deploy.agent.SILENCE", 0.05)
    path = tmp_path / "agent"
    assert _connected_to(path) is None
    with socket.socket(socket.AF_UNIX) as busy, socket.socket(socket.AF_UNIX) as waiting:
        busy.bind(str(path))
        busy.listen(0)
        waiting.connect(str(path))  # the queue is full now
        with pytest.raises(TimeoutError):
            _connected_to(path)
    assert _connected_to(path) is None, "nothing listens there any more"
