"""IceStorm under the topics of Ice: run for those who need it, away, dead, hung, and started again."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.qos import Durability, QoS, Reliability
from robocomp_py.errors import Closed, ConfigurationError, Timeout, TransportError
from robocomp_py.testing.conformance import Inbox, blob, greet, subscribe, topic
from robocomp_py.testing.faults import memory
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Outlet, Transport, TransportConfig, find_transport, hosting
from robocomp_py.transports.runtime_folder import runtime_dir

from .icestorm import free_storm, icestorm, open_ice, place_of, process_of

pytestmark = pytest.mark.tool

RELIABLE = QoS(Reliability.RELIABLE, depth=4)
LATCHED = QoS(Reliability.RELIABLE, Durability.TRANSIENT_LOCAL, depth=3)
NAME = "one/Storming/news"


@pytest.fixture
def storm() -> str:
    return free_storm()


@pytest.fixture
def running() -> Iterator[str]:
    with icestorm() as proxy:
        yield proxy


@pytest.fixture
def here(running: str) -> Iterator[Transport]:
    with contextlib.closing(open_ice()) as transport:
        yield transport


@pytest.fixture
def there(running: str) -> Iterator[Transport]:
    with contextlib.closing(open_ice()) as transport:
        yield transport


def hosted(storm: str, owner: str = "net") -> contextlib.AbstractContextManager[None]:
    return hosting("ice", TransportConfig({"storm": storm}, owner))


def answers(storm: str) -> bool:
    return place_of(storm).answers()


# -- running it ------------------------------------------------------------------------


def test_icestorm_answers_while_it_is_hosted_and_nothing_is_left_afterwards(storm: str) -> None:
    with hosted(storm):
        assert answers(storm)
        pid = process_of(storm)
    assert not Path(f"/proc/{pid}").exists()
    assert not list((runtime_dir() / "ice").glob("icestorm*"))


def test_icestorm_answers_at_an_ipv6_address(storm: str) -> None:
    there = storm.replace("127.0.0.1", '"::1"')
    with hosted(there):
        assert answers(there)


def test_a_running_icestorm_is_shared_and_replaced_when_it_ends(storm: str) -> None:
    with contextlib.ExitStack() as one, contextlib.ExitStack() as other:
        one.enter_context(hosted(storm, "one"))
        first = process_of(storm)
        other.enter_context(hosted(storm, "other"))
        assert process_of(storm) == first
        one.close()
        wait_until(lambda: answers(storm))
        assert process_of(storm) != first


def test_two_may_be_run_side_by_side_at_places_of_their_own(storm: str) -> None:
    with hosted(storm), icestorm() as other:
        assert process_of(storm) != process_of(other)


def test_an_icestorm_that_dies_is_reported_and_restarted(storm: str, caplog: pytest.LogCaptureFixture) -> None:
    with hosted(storm):
        first = process_of(storm)
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: "was killed by SIGKILL; starting it again" in caplog.text)
        wait_until(lambda: answers(storm))
        assert process_of(storm) != first


def test_icestorm_ends_with_its_host_process_even_if_that_is_killed(storm: str) -> None:
    program = (
        "import os; from robocomp_py.transports.base import hosting, TransportConfig\n"
        f"with hosting('ice', TransportConfig({{'storm': {storm!r}}}, 'net')): os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", program], timeout=SOON * 10)
    assert done.returncode == -signal.SIGKILL
    wait_until(lambda: not answers(storm))
    with hosted(storm):
        assert answers(storm)


def test_an_interrupt_while_it_starts_ends_the_program(storm: str, tmp_path: Path) -> None:
    """Also if it does not come up."""
    box, started = tmp_path / "icebox", tmp_path / "started"
    box.write_text(f"#!/bin/sh\n[ $1 = --version ] && exec echo 3.7.8\ntouch {started}\nexec sleep 600\n")
    box.chmod(0o755)
    program = (
        "from robocomp_py.transports.base import hosting, TransportConfig\n"
        f"with hosting('ice', TransportConfig({{'storm': {storm!r}}}, 'net')): pass"
    )
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    with subprocess.Popen([sys.executable, "-c", program], env=environment, stderr=subprocess.PIPE) as process:
        try:
            wait_until(started.exists)
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=SOON)
        finally:
            process.kill()
    assert b"KeyboardInterrupt" in said


def test_a_missing_icebox_is_reported_with_what_to_install(
    storm: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with hosted(storm):
        assert "there is no `icebox` to run it" in caplog.text
        assert "apt-get install zeroc-icebox libzeroc-icestorm3.7" in caplog.text


def test_a_port_of_another_program_is_reported(storm: str, caplog: pytest.LogCaptureFixture) -> None:
    place = place_of(storm)
    with socket.create_server((place.host, place.port)), hosted(storm):
        assert f"IceStorm cannot be run at {place}" in caplog.text
        assert "Address already in use" in caplog.text


def test_one_of_another_machine_is_not_run_here(caplog: pytest.LogCaptureFixture) -> None:
    with hosted("IceStorm/TopicManager:tcp -h 192.0.2.1 -p 9999"):
        assert not caplog.records


def test_what_names_no_topic_manager_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"transports\.ice\.storm: 'laser:tcp -p 10003' is not like"):
        hosted("laser:tcp -p 10003").__enter__()


# -- components and it -----------------------------------------------------------------


def test_without_one_a_topic_is_not_opened_and_the_error_says_what_to_start(
    storm: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from robocomp_py.transports.ice import storm_client

    monkeypatch.setattr(storm_client, "OPEN_TIMEOUT", 0.3)
    monkeypatch.setattr(storm_client, "LOG_AFTER", 0.05)
    with contextlib.closing(open_ice(storm=storm)) as transport:
        for use in (lambda: transport.outlet(topic(NAME)), lambda: transport.inlet(topic(NAME), lambda _: None)):
            with pytest.raises(
                TransportError, match=r"no IceStorm answers at .*start RoboComp's `rcnode` or `rc host "
            ):
                use()
    told = [line for line in caplog.messages if "waiting up to 0.3 s for IceStorm" in line]
    assert len(told) == 1
    assert "start RoboComp's `rcnode` or `rc host ice`" in told[0]


def test_an_icestorm_that_is_started_a_little_later_is_waited_for(storm: str) -> None:
    with contextlib.ExitStack() as later, contextlib.closing(open_ice(storm=storm)) as transport:
        later.callback(_soon(lambda: later.enter_context(hosted(storm))))
        assert transport.outlet(topic(NAME)).stats.dropped == 0


def test_closing_ends_a_wait_for_icestorm(storm: str) -> None:
    transport = open_ice(storm=storm)
    end = _soon(transport.close)
    with pytest.raises(Closed):
        transport.outlet(topic(NAME))
    end()


def test_a_stopping_component_does_not_wait_for_icestorm(storm: str) -> None:
    config = TransportConfig({"storm": storm}, "test", wanted=lambda: False)
    with contextlib.closing(find_transport("ice")(config)) as transport:
        for use in (lambda: transport.outlet(topic(NAME)), lambda: transport.inlet(topic(NAME), lambda _: None)):
            with pytest.raises(Closed, match="stopped while waiting for IceStorm"):
                use()


@pytest.mark.parametrize("qos", [QoS(), RELIABLE, LATCHED], ids=["best effort", "reliable", "latched"])
def test_publishers_and_subscribers_come_back_to_a_new_one(
    here: Transport, there: Transport, running: str, qos: QoS, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    inbox, outlet = subscribe(there, topic(NAME, qos)), here.outlet(topic(NAME, qos))
    for _ in range(2):
        greet(here, outlet, inbox)
        os.kill(process_of(running), signal.SIGKILL)
        wait_until(lambda: not outlet.wait_peer(0.0))
        _send_until(here, outlet, inbox)
        wait_until(lambda: outlet.wait_peer(0.0))
    assert "does not answer" in caplog.text
    assert "IceStorm answers again" in caplog.text


def test_history_is_asked_for_again_if_its_publisher_is_too_busy_to_answer(
    here: Any, there: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    here.outlet(topic(NAME, LATCHED)).send(blob(here, b"1"))
    history, asked = there.topic_service.history, list[int]()

    def history_late(topic_service: str, source: int) -> Any:
        asked.append(source)
        return history(topic_service, source) if len(asked) > 2 else None

    monkeypatch.setattr(there.topic_service, "history", history_late)
    assert subscribe(there, topic(NAME, LATCHED)).get(timeout=SOON) == b"1"


def test_without_icestorm_best_effort_continues_and_reliable_times_out(here: Transport, running: str) -> None:
    lossy, lossless = here.outlet(topic(NAME)), here.outlet(topic(NAME + "x", RELIABLE))
    os.kill(process_of(running), signal.SIGSTOP)
    try:
        for _ in range(1000):
            lossy.send(blob(here, bytes(10_000)))
        with pytest.raises(Timeout):
            _send_many(here, lossless)
        wait_until(lambda: lossy.stats.dropped or lossy.send(blob(here, bytes(10_000))))
    finally:
        os.kill(process_of(running), signal.SIGCONT)
    inbox = subscribe(here, topic(NAME + "x", RELIABLE))
    _send_until(here, lossless, inbox)


def test_a_reliable_publisher_of_large_messages_does_not_wait_for_what_was_taken(
    here: Transport, there: Transport
) -> None:
    """It may be some megabytes ahead, which are fewer messages than its depth."""
    deep = QoS(Reliability.RELIABLE, depth=1000)
    inbox, outlet = subscribe(there, topic(NAME, deep)), here.outlet(topic(NAME, deep))
    greet(here, outlet, inbox)
    for _ in range(100):
        outlet.send(blob(here, bytes(100_000)), SOON)
    wait_until(lambda: inbox.qsize() == 100)


def test_what_was_published_is_not_kept(here: Transport, there: Transport) -> None:
    inbox, outlet, large = subscribe(there, topic(NAME)), here.outlet(topic(NAME)), blob(here, bytes(1_000_000))
    greet(here, outlet, inbox)
    before = memory()
    for _ in range(100):
        outlet.send(large)
        inbox.get(timeout=SOON)
    assert memory() - before < 50_000_000


def test_an_unsubscribed_inlet_subscribes_again(here: Transport, there: Transport, running: str) -> None:
    """As IceStorm does with those it cannot reach for a while."""
    import Ice
    import IceStorm

    inbox, outlet = subscribe(there, topic(NAME, RELIABLE)), here.outlet(topic(NAME, RELIABLE))
    greet(here, outlet, inbox)
    with Ice.initialize() as communicator:
        manager = IceStorm.TopicManagerPrx.uncheckedCast(communicator.stringToProxy(running))
        found = manager.retrieve("Storming")
        for each in found.getSubscribers():
            found.unsubscribe(communicator.stringToProxy(communicator.identityToString(each)))
        assert not found.getSubscribers()
    _send_until(here, outlet, inbox)


def test_no_subscription_is_left_behind(here: Transport, running: str) -> None:
    import Ice
    import IceStorm

    with contextlib.closing(open_ice()) as other:
        subscribe(other, topic(NAME))
        link = here.inlet(topic(NAME, RELIABLE), lambda _: None)
        link.close()
    with Ice.initialize() as communicator:
        manager = IceStorm.TopicManagerPrx.uncheckedCast(communicator.stringToProxy(running))
        wait_until(lambda: not manager.retrieve("Storming").getSubscribers())


def test_two_networks_that_share_one_do_not_hear_each_other_but_by_their_topics(
    here: Transport, running: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A publisher that only another run-time folder knows is received all the same."""
    tmp_path.chmod(0o700)
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path))
    outlet = here.outlet(topic(NAME))
    with contextlib.closing(open_ice()) as stranger:
        inbox, deaf = subscribe(stranger, topic(NAME)), subscribe(stranger, topic("two/Storming/news"))
        assert outlet.wait_peer(SOON)
        outlet.send(blob(here, b"x"))
        assert inbox.get(timeout=SOON) == b"x"
        assert deaf.empty()


def _send_until(transport: Transport, outlet: Outlet, inbox: Inbox) -> None:
    """Until it arrives; meanwhile it may be that it cannot."""

    def arrived() -> bool:
        with contextlib.suppress(TransportError):
            outlet.send(blob(transport, b"again"), 0.2)
        return not inbox.empty()

    wait_until(arrived)


def _send_many(transport: Transport, outlet: Outlet) -> None:
    for _ in range(1000):
        outlet.send(blob(transport, bytes(10_000)), 0.2)


def _soon(act: Callable[[], object]) -> Callable[[], None]:
    """Have that done in a moment; returns what waits for it."""
    timer = threading.Timer(0.3, act)
    timer.start()
    return timer.join
