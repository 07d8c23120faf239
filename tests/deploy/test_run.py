"""What people are told while a network runs."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType

import pytest

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.agents import Agent, Usage
from robocomp_py.deploy.plan import Link, Member, OpenedTransport, Plan, Process
from robocomp_py.deploy.planner import make_plan
from robocomp_py.deploy.policy import Restart, State, When
from robocomp_py.deploy.run import Options, run, run_plan
from robocomp_py.deploy.telling import Display
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import TransportConfig

FOREVER = "import signal; signal.pause()"
NOTIFY = """
import os, socket
def notify(text):
    socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(text.encode(), os.environ["NOTIFY_SOCKET"])
"""
DEAF = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); signal.pause()"
"""Takes no notice of being told to stop."""


class Told(Display):
    """Remembers, and reacts: `on` is what to do when something is told for the first time, by its first word."""

    def __init__(self, **on: Callable[[], None]) -> None:
        self.said: list[tuple[str, ...]] = []
        self._on = on

    def line(self, name: str, text: str) -> None:
        self._say("line", name, text)

    def states(self, states: dict[str, State]) -> None:
        pass

    def up(self) -> None:
        self._say("up")

    def waiting(self, names: list[str]) -> None:
        self._say("waiting", *names)

    def ended(self, name: str, how: str) -> None:
        self._say("ended", name, how)

    def failed(self, name: str, how: str) -> None:
        self._say("failed", name, how)

    def tell(self, text: str) -> None:
        self._say("tell", text)

    def stopping(self, why: str) -> None:
        self._say("stopping", why)

    def _say(self, *words: str) -> None:
        if words not in self.said:
            self.said.append(words)
            self._on.pop(words[0], lambda: None)()


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def network(*links: Link, notifies: bool = True, after: str = "", **programs: str) -> Plan:
    """Programs in Python; the last one starts after the one named."""
    last = list(programs)[-1]
    processes = [
        Process(
            name,
            name,
            (sys.executable, "-ISc", text),
            Path.cwd(),
            after=(after,) if after and name == last else (),
            notifies=notifies,
        )
        for name, text in programs.items()
    ]
    return Plan("net", "", tuple(processes), links)


def test_instances_that_are_not_ready_are_reported_repeatedly_with_their_status() -> None:
    status = f"{NOTIFY}\nnotify('STATUS=looking for a map')\n{FOREVER}"
    reason = ("waiting", "hello (looking for a map)", "asker (after hello)")

    class Patient(Told):
        def waiting(self, names: list[str]) -> None:
            super().waiting(names)
            if ("waiting", *names) == reason:
                interrupt()

    told = Patient()
    assert run(network(hello=status, asker=FOREVER, after="hello"), Options(remind=0.01), told) == 130
    assert reason in told.said


def test_a_dependent_of_a_notifying_program_starts_when_the_program_is_ready(tmp_path: Path) -> None:
    warms_up = f"{NOTIFY}\nnotify('STATUS=warming up')\nopen('gate').read(1)\nprint('warm', flush=True)"
    (tmp_path / "lidar.py").write_text(f"{warms_up}\nnotify('READY=1')\n{FOREVER}")
    (tmp_path / "map.py").write_text("print('mapping')")
    (tmp_path / "program.cdsl").write_text("Component program { language python; };")
    network = tmp_path / "net.ddsl"
    network.write_text(f"""import "program.cdsl"; Deployment net {{
        Component lidar : program {{ existing "'{sys.executable}' -IS lidar.py"; notifies; }};
        Component map : program {{ existing "'{sys.executable}' -IS map.py"; dependences lidar; }};
    }};""")
    plan = make_plan(network, Workspace())
    assert plan is not None
    os.mkfifo(tmp_path / "gate")
    gate = os.open(tmp_path / "gate", os.O_RDWR)
    reason = ("waiting", "lidar (warming up)", "map (after lidar)")

    class Opening(Told):
        def waiting(self, names: list[str]) -> None:
            super().waiting(names)
            if ("waiting", *names) == reason:
                os.write(gate, b".")

    told = Opening()
    try:
        assert run(plan, Options(remind=0.01, until="map"), told) == 0
    finally:
        os.close(gate)
    said = [words for words in told.said if words == reason or words[0] == "line"]
    assert said == [reason, ("line", "lidar", "warm"), ("line", "map", "mapping")]


def test_a_failure_while_others_start_stops_them_and_names_the_failed_one() -> None:
    told = Told()
    program = "print('no camera'); raise SystemExit(1)"
    assert run(network(camera=program, waits=FOREVER), Options(), told) == 1
    failed = ("failed", "camera", "ended with exit code 1")
    assert told.said[-2:] == [failed, ("stopping", "camera ended before all components were ready")]


def test_a_program_that_fails_is_run_again_and_given_up_at_last() -> None:
    told = Told()
    plan = network(camera="import os; print(os.getpid()); raise SystemExit(3)")
    camera = replace(plan.processes[0], restart=Restart(When.ON_FAILURE, intensity=1, delay=0.0))
    assert run(replace(plan, processes=(camera,)), Options(), told) == 1
    first, second = (words[2] for words in told.said if words[0] == "line")
    assert first != second, "each start is a new process"
    assert [words for words in told.said if words[0] == "failed"] == [
        ("failed", "camera", "ended with exit code 3; started again at once"),
        ("failed", "camera", "ended with exit code 3; given up after 1 restart in 60 s"),
    ]


def test_a_required_instance_that_ends_while_its_clients_start_stops_the_network() -> None:
    told = Told()
    link = Link("Hello", "hello", "visitor", Verb.REQUIRES)
    assert run(network(link, hello="", visitor=FOREVER), Options(), told) == 1
    assert told.said[-2:] == [
        ("ended", "hello", "has ended"),
        ("stopping", "hello ended before all components were ready"),
    ]


SHARED = f"{NOTIFY}\nnotify('READY=1'); notify('X_ROBOCOMP_ENDED=lidar'); notify('X_ROBOCOMP_ENDED=nobody')\n{FOREVER}"


def sharing(plan: Plan, *instances: str) -> Plan:
    """A network of one process, with these in it."""
    members = tuple(Member(name, name) for name in instances)
    return replace(plan, processes=(replace(plan.processes[0], members=members),))


def shared(until: str) -> list[tuple[str, ...]]:
    """What is told of a process in which one of two ends, until the network does."""
    told = Told(ended=interrupt)
    plan = sharing(network(body=SHARED), "lidar", "camera")
    assert run(plan, Options(until=until), told) == (0 if until == "lidar" else 130)
    return [words for words in told.said if words[0] in ("ended", "stopping", "failed")]


def test_an_instance_that_ends_in_a_shared_process_is_reported_and_the_process_continues() -> None:
    assert shared(until="camera") == [("ended", "lidar", "has ended"), ("stopping", "asked to")]


def test_the_mission_may_end_before_its_process_does() -> None:
    assert shared(until="lidar") == [("stopping", "lidar has ended")]


def test_a_process_that_does_not_stop_in_time_is_reported_as_killed() -> None:
    told = Told(line=interrupt)
    assert run(network(deaf=DEAF), Options(grace=0.01), told) == 1
    assert told.said[-1] == ("failed", "deaf", "did not stop within 0.01 s; killed")


def test_a_process_has_time_for_each_component_in_it() -> None:
    told = Told(line=interrupt)
    assert run(sharing(network(deaf=DEAF), "one", "two"), Options(grace=0.01), told) == 1
    assert told.said[-1] == ("failed", "deaf", "did not stop within 0.02 s; killed")


def test_a_process_killed_on_the_users_request_has_not_failed() -> None:
    told = Told(line=interrupt, stopping=interrupt)
    assert run(network(deaf=DEAF), Options(grace=SOON * 6), told) == 130
    assert told.said[-1] == ("ended", "deaf", "was killed")


class Silent(Agent):
    """Of a host that accepts connections and says nothing: while it is reached, Ctrl-C is pressed."""

    async def open(self) -> None:
        interrupt()
        await asyncio.Event().wait()

    async def start(self, process: Process) -> None:
        raise AssertionError("it was never reached")

    def stop(self, name: str) -> None: ...

    def kill(self, name: str) -> None: ...

    def usage(self) -> dict[str, Usage]:
        return {}

    async def close(self) -> None: ...


def test_an_interrupt_while_a_host_is_reached_ends_it_without_a_traceback(caplog: pytest.LogCaptureFixture) -> None:
    told = Told()
    running = run_plan(network(hello=FOREVER), Options(), told, agents=lambda *_: {"": Silent()})
    assert asyncio.run(running) == 130
    gc.collect()  # asyncio reports unretrieved exceptions when they are collected
    assert told.said == [("stopping", "asked to")]
    assert [each.message for each in caplog.records] == []


def test_what_a_middleware_needs_is_there_as_long_as_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told()

    class Hosted:
        @staticmethod
        @contextmanager
        def host(config: TransportConfig) -> Iterator[None]:
            told.line("host", f"opened for {config.owner} with {dict(config.options)}")
            yield
            told.line("host", "closed")

    monkeypatch.setattr("robocomp_py.transports.base.find_transport", {"hosted": Hosted, "other": object}.get)
    transports = (OpenedTransport("hosted", {"domain": 7}), OpenedTransport("other"))
    assert run(replace(network(hello="print('hello')", notifies=False), transports=transports), Options(), told) == 0
    lines = [said[1:] for said in told.said if said[0] == "line"]
    assert lines == [
        ("host", "opened for rcdeploy net with {'domain': 7}"),
        ("hello", "hello"),
        ("host", "closed"),
    ]


def test_a_second_signal_does_not_disturb_cleanup_and_handlers_are_restored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told, while_closing = Told(line=lambda: os.kill(os.getpid(), signal.SIGTERM)), []

    def taken(number: int, frame: FrameType | None) -> None:
        raise AssertionError("the network takes it")

    class Hosted:
        @staticmethod
        @contextmanager
        def host(config: TransportConfig) -> Iterator[None]:
            yield
            while_closing.append(signal.getsignal(signal.SIGTERM))

    monkeypatch.setattr("robocomp_py.transports.base.find_transport", {"hosted": Hosted}.get)
    plan = replace(network(chatty=f"print('hello', flush=True); {FOREVER}"), transports=(OpenedTransport("hosted"),))
    before = signal.signal(signal.SIGTERM, taken)
    try:
        assert run(plan, Options(), told) == 143
        assert while_closing == [signal.SIG_IGN]
        assert signal.getsignal(signal.SIGTERM) is taken
    finally:
        signal.signal(signal.SIGTERM, before)


def test_the_router_of_a_zenoh_network_is_run_by_its_deployer(runtime_folder: Path) -> None:
    told = Told()
    program = f"import pathlib; print(pathlib.Path({str(runtime_folder)!r}, 'zenoh', 'router.lock').read_text())"
    plan = replace(network(curious=program, notifies=False), transports=(OpenedTransport("zenoh"),))
    assert run(plan, Options(), told) == 0
    assert ("line", "curious", f"rcdeploy net (pid {os.getpid()})") in told.said
    assert not (runtime_folder / "zenoh" / "router.lock").exists()


LEAVES_A_CHILD = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-ISc", "import time; time.sleep(600)"], start_new_session=True)
print(child.pid, flush=True)
"""


def test_a_detached_child_that_holds_the_pipe_does_not_delay_the_end() -> None:
    told = Told()
    assert run(network(daemon=LEAVES_A_CHILD, notifies=False), Options(), told) == 0
    (pid,) = (words[2] for words in told.said if words[0] == "line")
    with suppress(ProcessLookupError):  # it has been ended where there are control groups
        os.kill(int(pid), signal.SIGKILL)
