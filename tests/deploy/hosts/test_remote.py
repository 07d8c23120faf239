"""The agent of another host: over SSH to a server in this process, which runs what it is asked to on this machine."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import asyncssh
import pytest

from robocomp_py.deploy.hosts import ssh
from robocomp_py.deploy.hosts.lines import VERSION
from robocomp_py.deploy.hosts.remote import RemoteAgent, Share
from robocomp_py.deploy.hosts.trusting import remember
from robocomp_py.deploy.plan import Host
from robocomp_py.deploy.process import Process
from robocomp_py.errors import DeploymentError, HostUnreachable
from robocomp_py.testing.patience import SOON

from ..told import Told

FOREVER = "import os, time; print(os.getpid(), flush=True); time.sleep(1000)"


class Heard(Told):
    async def hears(self, *words: Any, times: int = 1) -> tuple[Any, ...]:
        """What is told that begins so, once it was told so often."""

        def matching() -> list[tuple[Any, ...]]:
            return [each for each in self.told if each[: len(words)] == words]

        await until(lambda: len(matching()) >= times, f"{words} among {self.told}")
        return matching()[times - 1]


async def until(condition: Callable[[], object], what: str = "") -> None:
    end = asyncio.get_running_loop().time() + 3 * SOON  # a process may have to start first
    while not condition():
        assert asyncio.get_running_loop().time() < end, f"not in {3 * SOON:g} s: {what}"
        await asyncio.sleep(0.005)


@dataclass
class Server:
    """Another host, as far as SSH knows."""

    host: Host
    home: Path
    connections: list[asyncssh.SSHServerConnection]
    options: dict[str, Any]

    def agent(self, heard: Heard, *processes: Process, host: Host | None = None, **more: Any) -> RemoteAgent:
        return RemoteAgent(host or self.host, Share("Net", processes, **more), heard, **self.options)

    def cut(self) -> None:
        """End all connections, without a word."""
        for connection in self.connections:
            connection.abort()
        self.connections.clear()


def program(code: str, name: str = "laser", **more: Any) -> Process:
    return Process(
        name, "Laser", (sys.executable, "-c", code), Path("/"), host="robot", notifies=False, is_program=True, **more
    )


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("SSH_AUTH_SOCK", raising=False)


@asynccontextmanager
async def serving(folder: Path, *, trusted: bool = True, runs: bool = True) -> AsyncIterator[Server]:
    """An SSH server. Unless it `runs` programs, it is asked for them and never answers."""
    key = asyncssh.generate_private_key("ssh-ed25519")
    host_key = asyncssh.generate_private_key("ssh-ed25519")
    there, connections = folder / "there", []
    there.mkdir(exist_ok=True)
    run = Path(os.environ["ROBOCOMP_RUNTIME_DIR"], f"host-{len(list(folder.iterdir()))}-{folder.name[-6:]}")
    run.mkdir(mode=0o700, exist_ok=True)
    environment = {**os.environ, "HOME": str(there), "ROBOCOMP_RUNTIME_DIR": str(run)}

    handling: list[asyncio.Future[None]] = []

    async def handle(process: asyncssh.SSHServerProcess[bytes]) -> None:
        handling.append(asyncio.ensure_future(run_there(process)))
        await asyncio.shield(handling[-1])  # which the end of the connection does not end

    async def run_there(process: asyncssh.SSHServerProcess[bytes]) -> None:
        pipe = asyncio.subprocess.PIPE
        ran = await asyncio.create_subprocess_shell(
            process.command or "", stdin=pipe, stdout=pipe, stderr=pipe, env=environment, cwd=there
        )
        assert ran.stdin and ran.stdout and ran.stderr  # noqa: PT018
        ways = [
            asyncio.ensure_future(_pump(process.stdin, ran.stdin)),
            asyncio.ensure_future(_pump(ran.stdout, process.stdout)),
            asyncio.ensure_future(_pump(ran.stderr, process.stderr)),
        ]
        try:
            await asyncio.wait([*ways[:1], asyncio.ensure_future(ran.wait())], return_when=asyncio.FIRST_COMPLETED)
        finally:
            ran.stdin.close()
            await asyncio.gather(*ways[1:], ran.wait(), return_exceptions=True)
            with suppress(OSError):
                process.exit(ran.returncode or 0)

    class Server_(asyncssh.SSHServer):
        def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
            connections.append(conn)

        async def session_requested(self) -> bool:  # type: ignore[override]  # asyncssh takes awaitables, too
            return await asyncio.get_running_loop().create_future()

    listening = await asyncssh.create_server(
        Server_,
        "127.0.0.1",
        0,
        server_host_keys=[host_key],
        authorized_client_keys=asyncssh.import_authorized_keys(key.export_public_key("openssh").decode()),
        process_factory=handle if runs else None,
        encoding=None,
    )
    port = listening.get_port()
    host = Host("robot", "127.0.0.1", "me", port, python=sys.executable)
    if trusted:
        remember(await ssh.key_of(host))
    try:
        yield Server(host, there, connections, {"client_keys": [key], "config": None})
    finally:
        listening.close()
        for connection in list(connections):
            connection.abort()
        await listening.wait_closed()
        await asyncio.gather(*handling)
        await until(lambda: not any(_agents(run)), "agents have ended")


async def _pump(reader: Any, writer: Any) -> None:
    with suppress(OSError, asyncssh.Error):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()


def _agents(run: Path) -> list[str]:
    """Agents and what they started, of that run-time folder."""
    found = []
    for folder in Path("/proc").iterdir():
        with suppress(OSError):
            if folder.name.isdecimal() and f"ROBOCOMP_RUNTIME_DIR={run}".encode() in (folder / "environ").read_bytes():
                found.append((folder / "cmdline").read_text())
    return found


def scene(act: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(act())  # type: ignore[arg-type]  # a coroutine


def test_processes_run_there_and_are_heard(tmp_path: Path):
    async def act() -> None:
        heard = Heard()
        code = "import os, sys; print(os.environ['SIDE'], os.getcwd()); sys.exit(3)"
        laser = program(code, env={"SIDE": "left"})
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser)
            await agent.open()
            await agent.start(laser)
            assert await heard.hears("exited", "laser") == ("exited", "laser", 3)
            await agent.close()
            assert heard.told[:2] == [
                ("ready", "laser"),
                ("output", "laser", f"left {server.home}/.robocomp/run/Net.robot"),
            ]

    scene(act)


def test_what_runs_is_stopped_and_killed_and_what_it_uses_is_known(tmp_path: Path):
    async def act() -> None:
        heard = Heard()
        deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); signal.pause()"
        laser, sonar = program(FOREVER), program(deaf, "sonar")
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser, sonar)
            await agent.open()
            await agent.start(laser)
            await agent.start(sonar)
            *_, pid = await heard.hears("output", "laser")
            await heard.hears("output", "sonar")
            await until(lambda: agent.usage().keys() == {"laser", "sonar"}, "both are measured")
            assert agent.usage()["laser"].pid == int(pid)
            agent.stop("laser")
            agent.stop("sonar")
            assert await heard.hears("exited", "laser") == ("exited", "laser", -15)
            agent.kill("sonar")
            assert await heard.hears("exited", "sonar") == ("exited", "sonar", -9)
            await agent.close()

    scene(act)


def test_a_missing_program_is_reported_at_its_start(tmp_path: Path):
    async def act() -> None:
        gone = replace(program(""), command=("/nowhere/driver",))
        async with serving(tmp_path) as server:
            agent = server.agent(Heard(), gone)
            await agent.open()
            with pytest.raises(DeploymentError, match="/nowhere/driver"):
                await agent.start(gone)
            await agent.close()

    scene(act)


def test_a_folder_that_a_command_names_is_there_under_another_name_and_is_sent_once(tmp_path: Path):
    async def act() -> None:
        own = tmp_path / "laser"
        own.mkdir()
        (own / "data.txt").write_text("here")
        code = "import pathlib, sys; print(sys.argv[1], pathlib.Path(sys.argv[1], 'data.txt').read_text())"
        laser = Process(
            "laser",
            "Laser",
            (sys.executable, "-c", code, str(own)),
            Path("/"),
            host="robot",
            notifies=False,
            is_program=True,
            files=(own,),
        )
        async with serving(tmp_path) as server:
            for times in (1, 2):
                heard = Heard()
                agent = server.agent(heard, laser)
                await agent.open()
                await agent.start(laser)
                _, _, line = await heard.hears("output", "laser")
                await agent.close()
                bundles = [each for each in (server.home / ".robocomp" / "bundles").iterdir() if each.is_dir()]
                assert line == f"{bundles[0]}/files/laser here"
                assert len(bundles) == 1
                if times == 1:
                    (bundles[0] / "files" / "laser" / "data.txt").write_text("here")  # would be written anew
                    inode = bundles[0].stat().st_ino
            assert bundles[0].stat().st_ino == inode

    scene(act)


def test_when_the_connection_is_lost_what_ran_there_is_stopped_and_can_be_started_again(tmp_path: Path):
    async def act() -> None:
        heard, laser = Heard(), program(FOREVER)
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser)
            await agent.open()
            await agent.start(laser)
            *_, pid = await heard.hears("output", "laser")
            server.cut()
            await heard.hears("lost", "robot")
            with suppress(DeploymentError):  # it may be back already
                await agent.start(laser)
                raise AssertionError("it is out of reach")
            await until(lambda: not Path(f"/proc/{pid}").exists(), "it has ended")
            await heard.hears("back", "robot")
            await agent.start(laser)
            *_, again = await heard.hears("output", "laser", times=2)
            assert again != pid
            await agent.close()

    scene(act)


def test_a_controller_that_was_stopped_itself_does_not_count_a_host_as_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    async def act() -> None:
        heard, laser, clock = Heard(), program(FOREVER), time.monotonic
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser)
            await agent.open()
            await agent.start(laser)
            await until(lambda: "laser" in agent.usage(), "it is measured")
            monkeypatch.setattr(time, "monotonic", lambda: clock() + 1000)
            before = agent.usage()
            await until(lambda: agent.usage() not in (before, {}), "it is measured again")
            assert not [told for told in heard.told if told[0] == "lost"]
            await agent.close()

    scene(act)


def test_when_the_agent_is_killed_nothing_of_it_is_left_and_another_one_takes_its_place(tmp_path: Path):
    async def act() -> None:
        heard, laser = Heard(), program(FOREVER)
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser)
            await agent.open()
            await agent.start(laser)
            *_, pid = await heard.hears("output", "laser")
            os.kill(_parent(int(pid)), signal.SIGKILL)
            await heard.hears("lost", "robot")
            await until(lambda: not Path(f"/proc/{pid}").exists(), "it has ended")
            await heard.hears("back", "robot")
            await agent.start(laser)
            await heard.hears("output", "laser", times=2)
            await agent.close()

    scene(act)


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def test_a_host_that_keeps_what_runs_hands_it_over(tmp_path: Path):
    async def act() -> None:
        heard, laser = Heard(), program(FOREVER)
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser, host=replace(server.host, keep=True))
            await agent.open()
            await agent.start(laser)
            *_, pid = await heard.hears("output", "laser")
            server.cut()
            await heard.hears("lost", "robot")
            await heard.hears("back", "robot")
            await agent.start(laser)
            await heard.hears("ready", "laser", times=2)
            await until(lambda: "laser" in agent.usage(), "it is measured")
            assert agent.usage()["laser"].pid == int(pid)
            await agent.close()
            assert not Path(f"/proc/{pid}").exists()

    scene(act)


def test_a_new_controller_takes_over_what_a_host_kept_and_ends_what_it_does_not_know(tmp_path: Path):
    async def act() -> None:
        heard, laser, sonar = Heard(), program(FOREVER), program(FOREVER, "sonar")
        async with serving(tmp_path) as server:
            keeping = replace(server.host, keep=True)
            first = server.agent(heard, laser, sonar, host=keeping)
            await first.open()
            await first.start(laser)
            await first.start(sonar)
            *_, pid = await heard.hears("output", "laser")
            *_, other = await heard.hears("output", "sonar")
            for task in first._tasks:  # as if its process had been killed
                task.cancel()
            server.cut()
            told = Heard()
            second = server.agent(told, laser, host=keeping)
            await second.open()
            await until(lambda: not Path(f"/proc/{other}").exists(), "it has ended")
            await second.start(laser)
            await until(lambda: "laser" in second.usage(), "it is measured")
            assert second.usage()["laser"].pid == int(pid)
            assert not any(each[1] == "sonar" for each in told.told)
            await second.close()

    scene(act)


def test_what_a_host_kept_and_is_now_described_otherwise_is_started_anew(tmp_path: Path):
    async def act() -> None:
        heard, laser = Heard(), program(FOREVER)
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser, host=replace(server.host, keep=True))
            await agent.open()
            await agent.start(laser)
            *_, pid = await heard.hears("output", "laser")
            server.cut()
            await heard.hears("back", "robot")
            await agent.start(replace(laser, env={"SIDE": "left"}))
            await heard.hears("output", "laser", times=2)
            assert not Path(f"/proc/{pid}").exists()
            assert not any(each[0] == "exited" for each in heard.told)
            await agent.close()

    scene(act)


def test_a_network_of_another_controller_is_not_taken_over(tmp_path: Path):
    async def act() -> None:
        laser = program(FOREVER)
        async with serving(tmp_path) as server:
            first = server.agent(Heard(), laser)
            await first.open()
            with pytest.raises(DeploymentError, match="Net is run there by another controller"):
                await server.agent(Heard(), laser).open()
            await first.start(laser)
            await first.close()

    scene(act)


def test_a_host_that_is_not_known_is_refused_with_its_fingerprint(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path, trusted=False) as server:
            shown = await ssh.key_of(server.host)
            with pytest.raises(HostUnreachable, match="is not known; its key is") as refused:
                await server.agent(Heard()).open()
            assert shown.fingerprint in str(refused.value)
            assert f"rcdeploy trust me@127.0.0.1:{server.host.port}" in str(refused.value)

    scene(act)


def test_a_host_with_another_key_than_the_known_one_is_refused_with_both(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            shown = await ssh.key_of(server.host)
            other = asyncssh.generate_private_key("ssh-ed25519")
            remember(replace(shown, key=other.export_public_key("openssh").decode().strip()))
            with pytest.raises(HostUnreachable, match="and the known one is") as refused:
                await server.agent(Heard()).open()
            assert shown.fingerprint in str(refused.value)
            assert other.get_fingerprint() in str(refused.value)

    scene(act)


def test_a_failed_login_is_reported_with_a_remedy(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            server.options["client_keys"] = [asyncssh.generate_private_key("ssh-ed25519")]
            with pytest.raises(HostUnreachable, match=r"login failed: .*ssh-copy-id"):
                await server.agent(Heard()).open()

    scene(act)


def test_a_name_that_no_host_has_is_told():
    with pytest.raises(HostUnreachable, match=r"nowhere\.invalid cannot be reached: unknown host name; give its"):
        ssh.presented("nowhere.invalid")


def test_a_host_that_does_not_answer_is_named(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            gone = server.host
        with pytest.raises(HostUnreachable, match=r"robot \(127\.0\.0\.1\) cannot be reached: .*is it on"):
            await server.agent(Heard(), host=gone).open()

    scene(act)


def test_a_host_that_takes_the_login_and_runs_no_program_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    async def act() -> None:
        async with serving(tmp_path, runs=False) as server:
            monkeypatch.setattr(ssh, "CONNECT_TIMEOUT", 1.0)
            logging_in = {"connect_timeout": SOON, "login_timeout": SOON}
            with pytest.raises(HostUnreachable, match=r"robot.*: it has not run a program within 1 s"):
                await ssh.run(server.host, ["true"], **server.options | logging_in)

    scene(act)


def test_a_missing_python_on_a_host_is_reported_with_a_remedy(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            with pytest.raises(
                HostUnreachable, match='there is no `python9`; if it is called otherwise: python "NAME"'
            ):
                await server.agent(Heard(), host=replace(server.host, python="python9")).open()

    scene(act)


def test_missing_packages_on_a_host_are_reported_with_a_remedy(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            agent = server.agent(Heard(), needs={"numpy": "numpy>=1.26", "carrier_pigeon": "carrier-pigeon>=2"})
            with pytest.raises(HostUnreachable, match=r"-m pip install 'carrier-pigeon>=2'$"):
                await agent.open()

    scene(act)


def test_a_shell_that_says_something_first_does_not_come_between(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            wrapper = tmp_path / "python"
            wrapper.write_text(f'#!/bin/sh\necho Welcome, {{you}}\necho\nexec {sys.executable} "$@"\n')
            wrapper.chmod(0o755)
            agent = server.agent(Heard(), host=replace(server.host, python=str(wrapper)))
            await agent.open()
            await agent.close()

    scene(act)


def test_a_folder_to_work_in_is_made_and_used(tmp_path: Path):
    async def act() -> None:
        heard, laser = Heard(), program("import os; print(os.getcwd())")
        async with serving(tmp_path) as server:
            agent = server.agent(heard, laser, host=replace(server.host, workdir="patrol/today"))
            await agent.open()
            await agent.start(laser)
            assert await heard.hears("output", "laser") == ("output", "laser", str(server.home / "patrol" / "today"))
            await agent.close()
            assert (server.home / "patrol" / "today" / ".robocomp").is_dir()

    scene(act)


BOOT = {"tell": "boot", "there": True, "root": "/r", "python": "/p", "folder": "/f"}
HELLO = {"tell": "hello", "version": VERSION, "kept": []}
OPENED = {"tell": "opened"}


def impostor(folder: Path, *said: object) -> str:
    """A program to be taken for Python, which says this, whatever it is asked."""
    path, text = folder / "impostor", "".join(json.dumps(each) + "\n" for each in said)
    path.write_text(f"#!{sys.executable}\nimport sys\nprint({text!r}, end='', flush=True)\nsys.stdin.buffer.read()\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    "said",
    [
        {"tell": "output", "name": "laser"},
        {"tell": "output", "name": ["laser"], "line": "x"},
        {"tell": "exited", "name": "laser", "code": "0"},
        {"tell": "failed", "name": "laser", "why": None},
        {"tell": "usage", "of": {"laser": [1, "much", 1, 1, 1]}},
        {"tell": "usage", "of": {"laser": 1}},
        {"tell": "usage", "of": {"laser": [1, 1, 10**400, 1, 1, 1, {}]}},
        {"tell": "usage", "of": {"laser": [1, float("inf"), 1, 1, 1, 1, {}]}},
        {"tell": "usage", "of": {"laser": [1, 1, 1, 1, float("nan"), 1, {}]}},
        {"tell": "exited", "name": "laser", "code": -(10**4000)},
        {"tell": ["output"]},
        {"do": "start"},
    ],
)
def test_a_host_that_says_what_it_must_not_is_lost(tmp_path: Path, said: object):
    async def act() -> None:
        heard = Heard()
        async with serving(tmp_path) as server:
            host = replace(server.host, python=impostor(tmp_path, BOOT, HELLO, OPENED, said))
            agent = server.agent(heard, program(FOREVER), host=host)
            await agent.open()
            assert "malformed" in (await heard.hears("lost", "robot"))[2]
            await agent.close()

    scene(act)


@pytest.mark.parametrize(
    "said",
    [
        [{**BOOT, "root": 7}],
        [BOOT, {**HELLO, "kept": 5}],
        [{"tell": "refused", "why": "\x1b[2Jwiped"}],
        [BOOT, {"tell": "refused"}],
    ],
)
def test_a_host_that_begins_so_is_refused_by_name_and_shown_nothing_raw(tmp_path: Path, said: list[object]):
    async def act() -> None:
        async with serving(tmp_path) as server:
            host = replace(server.host, python=impostor(tmp_path, *said))
            with pytest.raises(HostUnreachable, match=r"robot \(127\.0\.0\.1\): .*(malformed|wiped)") as caught:
                await server.agent(Heard(), host=host).open()
            assert "\x1b" not in str(caught.value)

    scene(act)


def test_a_host_speaks_of_its_own_processes_only_a_line_at_a_time(tmp_path: Path):
    async def act() -> None:
        heard = Heard()
        others = [
            {"tell": "output", "name": "sonar", "line": "x"},
            {"tell": "exited", "name": "sonar", "code": 0},
            {"tell": "ready", "name": ""},
            {"tell": "usage", "name": ["laser"], "of": {}},
            {"tell": "usage", "of": {"sonar": [*[1] * 6, {}], "laser": [*[1] * 6, {}]}},
        ]
        own = [
            {"tell": "status", "name": "laser", "text": "\x1b[2Jfine"},
            {"tell": "contract", "name": "laser", "instance": "laser", "operations": {"M::I.a\x1b[2J": "1"}},
            {"tell": "output", "name": "laser", "line": "a\nb" + 10_000 * "c"},
        ]
        async with serving(tmp_path) as server:
            host = replace(server.host, python=impostor(tmp_path, BOOT, HELLO, OPENED, *others, *own))
            agent = server.agent(heard, program(FOREVER), host=host)
            await agent.open()
            *_, line = await heard.hears("output", "laser")
            assert (line[:4], len(line), list(agent.usage())) == ("a bc", 4096, ["laser"])
            assert heard.told[0] == ("status", "laser", " [2Jfine")
            assert heard.told[1] == ("contract", "laser", "laser", {"M::I.a [2J": "1"})
            server.cut()
            await agent.close()

    scene(act)


def test_a_scout_tells_what_runs_there_and_ends_with_its_tool(tmp_path: Path):
    async def act() -> None:
        async with serving(tmp_path) as server:
            agent = server.agent(Heard(), program(FOREVER))
            await agent.open()
            scouts = [agent.scout() for _ in range(2)]
            for each in scouts:
                each.say(json.dumps({"id": 1, "do": "census", "middlewares": ["zeromq"]}))
            told: list[list[str]] = [[], []]
            for each, lines in zip(scouts, told, strict=True):
                while not any('"end"' in line for line in lines):
                    async with asyncio.timeout(SOON):
                        await each.news.wait()
                    lines += each.taken()
            assert told[0] == told[1]
            assert json.loads(told[0][0]) == {"id": 1, "tellers": ["zeromq"], "troubles": []}
            scouts[0].close()
            await agent.close()
            assert [each.has_ended for each in scouts] == [True, True]
            assert scouts[1].is_lost

    scene(act)
