"""What `rc doctor` finds in networks whose components run, and which are broken on purpose."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import QoS
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import asking
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.transports.base import find_transport

from ..faults.surroundings import with_clock
from ..runtime.components import Calculator, Diary, EverythingProxy, EverythingPublisher
from ..runtime.running import make, running
from .commands import TELLERS
from .talkers import Listener
from .test_doctor import said

Said = pytest.CaptureFixture[str]

ROOT = Path(__file__).parents[2]

OLDER = replace(
    e.EVERYTHING,
    operations=(replace(e.divide, outputs=e.divide.outputs[:1]), replace(e.news, inputs=e.news.inputs[:1])),
)
"""Before `divide` gave back a remainder, and `news` had a text."""


class OlderServer(Diary):
    component = Component("calculator", (Port(Verb.IMPLEMENTS, OLDER),), period=0.005)

    def Everything_divide(self, dividend: int, divisor: int) -> int:
        return dividend // divisor


class OlderClient(Diary):
    component = Component("client", (Port(Verb.REQUIRES, OLDER, proxy=EverythingProxy),), period=0.005)


class OlderListener(Diary):
    component = Component("listener", (Port(Verb.SUBSCRIBES, OLDER),), period=0.005)

    def Everything_news(self, number: int) -> None:
        self.entries.append(str(number))


class Murmurer(Diary):
    """Publishes without any promise."""

    component = Component(
        "murmurer", (Port(Verb.PUBLISHES, e.EVERYTHING, proxy=EverythingPublisher, qos=QoS()),), period=0.005
    )


class Slow(Diary):
    """Takes four times as long as its period."""

    component = Component("slow", period=0.005)

    def compute(self) -> None:
        threading.Event().wait(0.02)


@pytest.fixture(params=TELLERS)
def over(request: pytest.FixtureRequest) -> str:
    """A middleware."""
    return str(request.param)


def run(worker: type[Diary], middleware: str, *, ready: bool = True) -> contextlib.AbstractContextManager[object]:
    return running(make(worker, find_transport, f"middleware={middleware}"), ready=ready)


def wait_for_ends(middleware: str, channel: str, *owners: str) -> None:
    """Return as soon as these components have an end of a channel, and can be asked what they are."""

    def there() -> bool:
        network = take_census([middleware])
        known = {*asking.components(network)}
        ends = network.channels[channel].ends if channel in network.channels else []
        return {*owners} <= {end.told.owner for end in ends} & known

    wait_until(there)


def test_a_client_whose_server_was_replaced_by_one_with_another_contract_is_found(over: str, capsys: Said) -> None:
    with contextlib.ExitStack() as client:
        with run(OlderServer, over):
            client.enter_context(run(OlderClient, over))
        with run(Calculator, over):
            wait_for_ends(over, "calculator/Everything/divide", "calculator", "client")
            (found,) = said(capsys, "--check", "contracts", "--middleware", over, code=1)
    assert (found["weight"], found["text"]) == (
        "error",
        "client and calculator disagree on calculator/Everything/divide: "
        "Conformance::EverythingDivideResponse.remainder: absent here, int64 there",
    )


def test_a_subscriber_with_another_contract_than_its_publisher_is_found(over: str, capsys: Said) -> None:
    with run(Murmurer, over), run(OlderListener, over, ready=False):
        wait_for_ends(over, "murmurer/Everything/news", "murmurer", "listener")
        (found,) = said(capsys, "--check", "contracts", "--middleware", over, code=1)
    assert (found["weight"], found["text"]) == (
        "error",
        "listener and murmurer disagree on murmurer/Everything/news: "
        "Conformance::EverythingNewsRequest.text: absent here, string there",
    )


def test_a_subscriber_that_asks_for_more_than_its_publisher_offers_is_found(over: str, capsys: Said) -> None:
    with run(Murmurer, over), run(Listener, over, ready=False):
        wait_for_ends(over, "murmurer/Everything/news", "murmurer", "listener")
        (found,) = said(capsys, "--check", "qos", "--middleware", over, code=1)
    assert (found["weight"], found["text"]) == (
        "error",
        "listener gets less than it asks for from murmurer/Everything/news: "
        "`reliable` is asked for, `best_effort` is offered",
    )


def test_a_component_that_takes_longer_than_its_period_is_found(capsys: Said) -> None:
    made = make(Slow, find_transport, "middleware=zeromq")
    with running(made):
        wait_until(lambda: "slow" in asking.components(take_census(["zeromq"])))
        wait_until(lambda: made.overruns > 100)
        (found,) = said(capsys, "--check", "overruns", "--middleware", "zeromq", code=1)
    assert found["weight"] == "error"
    assert found["text"].startswith("slow left out ")


VICTIM = """
import sys
from robocomp_py.transports.base import find_transport
from tests.runtime.components import Calculator
from tests.runtime.running import make
make(Calculator, find_transport, f"middleware={sys.argv[1]}", name="victim").run()
"""


def answers(middleware: str) -> bool:
    """Whether the victim is there and ready: it announces its channels before it answers."""
    with Access() as access:
        return asking.describe(access, take_census([middleware]), "victim", 1.0) is not None


@contextlib.contextmanager
def victim(middleware: str, *before: str) -> Iterator[None]:
    """A component in a process of its own, which is killed in the end. `before` starts its command."""
    process = subprocess.Popen([*before, sys.executable, "-c", VICTIM, middleware], cwd=ROOT)
    try:
        wait_until(lambda: answers(middleware), 3 * SOON)
        yield
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("middleware", ["zeromq", "shm"])
def test_what_a_killed_component_has_left_is_found(middleware: str, own_runtime_folder: Path, capsys: Said) -> None:
    with victim(middleware):
        assert said(capsys, "--check", "leftovers", "--middleware", middleware, code=0) == []
    found = said(capsys, "--check", "leftovers", "--middleware", middleware, code=1)
    assert found[0]["text"].startswith("killed processes have left ")
    assert all(each["weight"] == "warn" for each in found)


FULL = """
import os
from robocomp_py.cli import rc
from robocomp_py.transports.base import find_transport
from tests.runtime.components import Calculator
from tests.runtime.running import make, running
with running(make(Calculator, find_transport, "middleware=shm")):
    free = os.statvfs("/dev/shm").f_bavail * os.statvfs("/dev/shm").f_frsize
    with open("/dev/shm/large", "wb") as file:
        os.posix_fallocate(file.fileno(), 0, free - (1 << 20))
    raise SystemExit(rc.main(["doctor", "--check", "memory", "--middleware", "shm", "--json"]))
"""


@pytest.mark.tool  # mounts another /dev/shm in a namespace of its own: needs root
def test_full_shared_memory_is_found(own_runtime_folder: Path) -> None:
    mounted = 'mount -t tmpfs -o size=256m tmpfs /dev/shm && exec "$0" -c "$1"'
    command = ["unshare", "--mount", "sh", "-c", mounted, sys.executable, FULL]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    assert (found["weight"], found["check"]) == ("error", "memory")
    assert found["text"].startswith("/dev/shm has 1.05 MB of 268 MB left")


@pytest.mark.tool  # a host name in a namespace of its own, and libfaketime: needs root
@pytest.mark.parametrize(("offset", "weight", "text"), [("+90s", "error", "ahead"), ("-0.5", "warn", "behind")])
def test_a_clock_that_differs_from_ours_is_found(
    offset: str, weight: str, text: str, own_runtime_folder: Path, tmp_path: Path, capsys: Said
) -> None:
    clock = tmp_path / "clock"
    clock.write_text(offset)
    with_its_clock = ("env", *(f"{name}={value}" for name, value in with_clock(clock).items()))
    with victim("zeromq", "unshare", "--uts", "sh", "-c", 'hostname elsewhere && exec "$0" "$@"', *with_its_clock):
        (found,) = said(capsys, "--check", "clocks", "--middleware", "zeromq", code=1)
    assert found["weight"] == weight
    assert found["text"].startswith("the clock of elsewhere is ")
    assert found["text"].endswith(text)
