"""Calls over Ice: how large they may be, where servers are, and what happens to them with servers of Ice's own."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.errors import AlreadyServed, Closed, ConfigurationError, Refused, Timeout, TransportError, Unreachable
from robocomp_py.testing.faults import memory
from robocomp_py.testing.parts import A_MOMENT, Inbox, blob, command, put, query, unblob
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Caller, Outlet, Reply, Status, Transport, TransportConfig, find_transport
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.wire.codec import Payload
from tests.freeports import free_port

pytestmark = pytest.mark.tool

NAME = "server/Conformance/op"
LIMIT = 100_000

ECHO = """
import sys, Ice
class Echo(Ice.Blobject):
    def ice_invoke(self, octets, current):
        if current.operation == "op" and b"stuck" in octets:
            print("stuck", flush=True)
            sys.stdin.read()
        if b"odd" in octets:
            raise ValueError("odd")
        if b"gone" in octets:
            raise Ice.ObjectNotExistException()
        return True, (300_006).to_bytes(4, "little") + b"\\1\\1" + bytes(300_000) if b"grow" in octets else octets
with Ice.initialize(["--Ice.Default.Host=127.0.0.1", *sys.argv[2:]]) as communicator:
    adapter = communicator.createObjectAdapterWithEndpoints("Echo", sys.argv[1])
    adapter.add(Echo(), Ice.stringToIdentity("conformance"))
    adapter.activate()
    print("ready", flush=True)
    sys.stdin.read()
"""
"""A program of Ice's own."""

Open = Callable[..., Transport]


@pytest.fixture
def opening() -> Iterator[Open]:
    with contextlib.ExitStack() as opened:

        def transport(**options: Any) -> Transport:
            made = find_transport("ice")(TransportConfig(options, "test"))
            opened.callback(made.close)
            return made

        yield transport


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(4) as executor:
        yield executor


@pytest.fixture
def endpoint() -> str:
    return f"tcp -h 127.0.0.1 -p {free_port()}"


class Echo:
    """That program, which runs until it is ended."""

    def __init__(self, endpoint: str, *properties: str) -> None:
        pipe = subprocess.PIPE
        command = [sys.executable, "-c", ECHO, endpoint, *properties]
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)

    def said(self) -> str:
        assert self._process.stdout
        return self._process.stdout.readline().strip()

    def signal(self, number: int) -> None:
        self._process.send_signal(number)
        if number == signal.SIGSTOP:
            wait_until(self._is_stopped)

    def _is_stopped(self) -> bool:
        """Whether all of its threads are, which takes the kernel a moment."""
        stats = [each.read_text() for each in Path(f"/proc/{self._process.pid}/task").glob("*/stat")]
        return all(stat.rpartition(")")[2].split()[0] == "T" for stat in stats)

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.fixture
def echo(endpoint: str) -> Iterator[Callable[..., Echo]]:
    with contextlib.ExitStack() as running:

        def start(*properties: str) -> Echo:
            program = Echo(endpoint, *properties)
            running.callback(program.end)
            assert program.said() == "ready"
            return program

        yield start


@pytest.fixture
def asking(opening: Open, endpoint: str) -> Transport:
    """It knows where the program is to be."""
    return opening(proxies={"server": f"conformance:{endpoint}"})


def echoing(transport: Transport, name: str = NAME) -> None:
    transport.server(query(name), lambda payload, expires: Reply(Status.OK, payload))


def question(transport: Transport, caller: Caller, how: str, data: bytes, deadline: float = SOON) -> bytes:
    payload = blob(transport, data)
    reply = caller.ask(payload, deadline) if how == "ask" else caller.call(payload, deadline).result(SOON * 3)
    assert reply.status is Status.OK, reply
    return unblob(transport, reply.payload)


both_ways = pytest.mark.parametrize("how", ["ask", "call"])


# How large.


@both_ways
def test_a_request_larger_than_its_server_takes_is_not_sent_and_says_so(opening: Open, how: str) -> None:
    echoing(opening(message_size_max=LIMIT))
    there = opening()
    caller = there.caller(query(NAME))
    with pytest.raises(TransportError, match=r"too large: .* allow 100000; raise `message_size_max`"):
        question(there, caller, how, bytes(LIMIT))
    assert question(there, caller, how, bytes(LIMIT - 300)) == bytes(LIMIT - 300)


@both_ways
def test_a_reply_too_large_for_its_client_is_a_failure(opening: Open, how: str) -> None:
    here, there = opening(), opening(message_size_max=LIMIT)
    here.server(query(NAME), lambda payload, expires: Reply(Status.OK, blob(here, unblob(here, payload) * 2)))
    caller = there.caller(query(NAME))
    payload = blob(there, bytes(LIMIT - 1000))
    reply = caller.ask(payload, SOON) if how == "ask" else caller.call(payload, SOON).result(SOON)
    assert reply.status is Status.FAILED
    assert b"the reply has" in reply.payload
    assert question(there, caller, how, b"12") == b"1212"


def test_a_command_larger_than_its_server_takes_is_not_sent(opening: Open) -> None:
    here, there, inbox = opening(message_size_max=LIMIT), opening(), Inbox()
    here.inlet(command(NAME), put(here, inbox))
    outlet = there.outlet(command(NAME))
    with pytest.raises(TransportError, match="too large"):
        outlet.send(blob(there, bytes(LIMIT)))
    outlet.send(blob(there, b"small"))
    assert inbox.get(timeout=SOON) == b"small"


@both_ways
def test_a_program_that_takes_less_than_we_know_is_named_with_its_setting(
    asking: Transport, echo: Callable[..., Echo], how: str
) -> None:
    echo()
    caller = asking.caller(query(NAME))
    with pytest.raises(Unreachable, match=r"Ice\.MessageSizeMax"):
        question(asking, caller, how, bytes(2_000_000))
    assert question(asking, caller, how, bytes(1_000_000)) == bytes(1_000_000)


@both_ways
def test_an_answer_of_such_a_program_that_is_too_large_ends_its_call_alone(
    opening: Open, endpoint: str, echo: Callable[..., Echo], how: str
) -> None:
    echo()
    there = opening(proxies={"server": f"conformance:{endpoint}"}, message_size_max=LIMIT)
    caller = there.caller(query(NAME))
    with pytest.raises(TransportError, match="larger than `message_size_max`"):
        question(there, caller, how, b"grow")
    assert question(there, caller, how, b"small") == b"small"


# Where.


def test_a_server_listens_at_the_endpoint_of_its_port(opening: Open, endpoint: str, asking: Transport) -> None:
    here = opening(endpoints={"Conformance": endpoint})
    caller = asking.caller(query(NAME))
    assert not caller.wait_peer(0.0)
    echoing(here)
    assert caller.wait_peer(SOON)
    assert question(asking, caller, "ask", b"found") == b"found"


def test_an_endpoint_that_is_taken_is_named(opening: Open, endpoint: str) -> None:
    echoing(opening(endpoints={"Conformance": endpoint}))
    with pytest.raises(TransportError, match=rf"listening at '{endpoint}' for conformance: .*in use"):
        echoing(opening(endpoints={"Conformance": endpoint}), "other/Conformance/op")


def test_an_endpoint_is_free_again_when_nothing_is_served_there(opening: Open, endpoint: str) -> None:
    here, there = (opening(endpoints={"Conformance": endpoint}) for _ in range(2))
    for transport in (here, there, here):
        server = transport.server(query(NAME), lambda payload, expires: Reply(Status.OK, payload))
        assert question(transport, transport.caller(query(NAME)), "ask", b"x") == b"x"
        server.close()


def test_several_operations_of_an_interface_are_one_object(opening: Open, endpoint: str) -> None:
    here = opening(endpoints={"Conformance": endpoint})
    first, second = (here.server(query(name), _upper(here)) for name in (NAME, NAME + "two"))
    there = opening(proxies={"server": f"conformance:{endpoint}"})
    callers = [there.caller(query(name)) for name in (NAME, NAME + "two")]
    assert [question(there, caller, "ask", b"x") for caller in callers] == [b"X", b"X"]
    first.close()
    with pytest.raises(Unreachable, match="its server left"):
        callers[0].ask(blob(there, b"x"), SOON)
    assert question(there, callers[1], "ask", b"x") == b"X"
    second.close()
    with pytest.raises(Unreachable):
        callers[1].ask(blob(there, b"x"), SOON)


def _upper(transport: Transport) -> Callable[[Any, float], Reply]:
    return lambda payload, expires: Reply(Status.OK, blob(transport, unblob(transport, payload).upper()))


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"proxies": {"server": "conformance"}}, "says no place"),
        ({"proxies": {"server": "conformance:tcp -h localhost -p x"}}, "is not a port"),
        ({"endpoints": {"Conformance": "top -p 1"}}, "protocol"),
        ({"message_size_max": -1}, "message_size_max"),
        ({"messages": 1}, "messages"),
    ],
)
def test_options_that_make_no_sense_are_refused(opening: Open, options: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigurationError, match=why):
        opening(**options)


def test_a_client_with_a_configured_proxy_ignores_the_run_time_folder(opening: Open, asking: Transport) -> None:
    echoing(opening())
    with pytest.raises(Unreachable, match=r"is not there: .*refused"):
        question(asking, asking.caller(query(NAME)), "ask", b"x")


def test_waiting_for_an_unknown_object_is_reported(
    opening: Open, endpoint: str, echo: Callable[..., Echo], caplog: pytest.LogCaptureFixture
) -> None:
    echo()
    caller = opening(proxies={"server": f"Conformance:{endpoint}"}).caller(query(NAME))
    wait_until(lambda: not caller.wait_peer(A_MOMENT) and caplog.messages)
    [told] = caplog.messages
    assert told == f"Conformance:{endpoint}: the program there has no object `Conformance`; waiting for it"


def test_an_address_that_is_no_address_of_this_machine_is_named(opening: Open) -> None:
    with pytest.raises(TransportError, match=r"listening at 'tcp' of 192\.0\.2\.1 for conformance: Cannot assign"):
        echoing(opening(host="192.0.2.1"))


def test_a_host_that_does_not_exist_is_unreachable(opening: Open, caplog: pytest.LogCaptureFixture) -> None:
    there = opening(proxies={"server": "conformance:tcp -h nowhere.invalid -p 10003"})
    caller = there.caller(query(NAME))
    assert not caller.wait_peer(0.0)
    wait_until(lambda: not caller.wait_peer(0.0) and "host not found" in caplog.text)
    with pytest.raises(Unreachable, match=r"nowhere\.invalid"):
        question(there, caller, "ask", b"x")


# Programs of Ice's own that fail.


@both_ways
def test_a_program_that_is_killed_in_a_call_makes_it_unreachable(
    asking: Transport, echo: Callable[..., Echo], how: str, pool: ThreadPoolExecutor
) -> None:
    program = echo()
    asked = pool.submit(question, asking, asking.caller(query(NAME)), how, b"stuck", SOON * 3)
    assert program.said() == "stuck"
    program.signal(signal.SIGKILL)
    with pytest.raises(Unreachable):
        asked.result(SOON)


@both_ways
def test_a_program_that_hangs_is_waited_for_until_the_deadline(
    asking: Transport, echo: Callable[..., Echo], how: str
) -> None:
    program = echo()
    caller = asking.caller(query(NAME))
    assert question(asking, caller, how, b"x") == b"x"
    program.signal(signal.SIGSTOP)
    for _ in range(2):  # by the connection that there was, and by a new one
        begun = time.monotonic()
        with pytest.raises(Timeout):
            question(asking, caller, how, b"x", A_MOMENT)
        assert time.monotonic() - begun >= A_MOMENT * 0.9
    assert not caller.wait_peer(A_MOMENT)
    program.signal(signal.SIGCONT)
    assert caller.wait_peer(SOON)
    assert question(asking, caller, how, b"x") == b"x"


@both_ways
def test_calls_that_give_up_soon_do_not_each_leave_a_connection_to_a_hung_server(
    asking: Transport, echo: Callable[..., Echo], how: str
) -> None:
    echo().signal(signal.SIGSTOP)
    caller, before = asking.caller(query(NAME)), sockets()
    for _ in range(30):
        with pytest.raises(Timeout):
            question(asking, caller, how, b"x", 0.01)
    assert len(sockets() - before) < 5


def test_what_one_raises_does_not_cost_the_connection(asking: Transport, echo: Callable[..., Echo]) -> None:
    echo("--Ice.Warn.Dispatch=0")
    caller = asking.caller(query(NAME))
    question(asking, caller, "ask", b"x")
    before = sockets()
    assert caller.ask(blob(asking, b"odd"), SOON).status is Status.FAILED
    with pytest.raises(Refused, match="does not serve it"):
        caller.ask(blob(asking, b"gone"), SOON)
    assert sockets() == before


@both_ways
def test_a_program_that_is_started_again_is_found_where_it_was(
    asking: Transport, echo: Callable[..., Echo], how: str
) -> None:
    caller, outlet = asking.caller(query(NAME)), asking.outlet(command(NAME))
    for _ in range(3):
        program = echo()
        assert caller.wait_peer(SOON)
        assert question(asking, caller, how, b"x") == b"x"
        outlet.send(blob(asking, b"x"))
        program.end()
        with pytest.raises(Unreachable):
            question(asking, caller, how, b"x")
        with pytest.raises(Unreachable):
            outlet.send(blob(asking, b"x"))


@both_ways
def test_closing_releases_waits_for_a_hanging_server(
    asking: Transport, echo: Callable[..., Echo], how: str, pool: ThreadPoolExecutor
) -> None:
    echo().signal(signal.SIGSTOP)
    caller = asking.caller(query(NAME))
    asked = pool.submit(question, asking, caller, how, b"x", SOON * 3)
    wait_until(asked.running)
    caller.close()
    with pytest.raises(Closed):
        asked.result(SOON)


def test_commands_to_one_that_hangs_end_at_their_deadline(asking: Transport, echo: Callable[..., Echo]) -> None:
    program = echo()
    outlet = asking.outlet(command(NAME))
    outlet.send(blob(asking, b"x"))
    program.signal(signal.SIGSTOP)
    with pytest.raises(Timeout):
        _send_until_it_fails(outlet, blob(asking, bytes(1_000_000)))


def _send_until_it_fails(outlet: Outlet, payload: Payload) -> None:
    for _ in range(1000):
        outlet.send(payload, A_MOMENT)


# What is left.


def test_a_closed_transport_leaves_no_thread_socket_or_file(opening: Open) -> None:
    opening().close()  # what is opened once and kept, of Python's
    # of tests before this one, threads may still be on their way out
    before, before_files = (threads(), sockets()), files()
    here, there = opening(), opening()
    echoing(here)
    here.server(query(NAME + "stuck"), lambda payload, expires: Future())
    caller, stuck = there.caller(query(NAME)), there.caller(query(NAME + "stuck"))
    assert [question(there, caller, how, b"x") for how in ("ask", "call")] == [b"x", b"x"]
    asked = stuck.call(blob(there, b"x"), SOON * 3)
    assert sockets() > before[1]
    assert files() > before_files
    here.close()
    with pytest.raises(Unreachable, match="left"):
        asked.result(SOON)
    there.close()
    wait_until(lambda: threads() <= before[0])
    assert sockets() <= before[1]
    assert files() == before_files


def threads() -> int:
    return len(os.listdir("/proc/self/task"))


def sockets() -> set[str]:
    links = (Path("/proc/self/fd", each) for each in os.listdir("/proc/self/fd"))
    return {name for each in links if each.is_symlink() and (name := os.readlink(each)).startswith("socket:")}


def files() -> set[str]:
    return {str(path) for path in runtime_dir().rglob("*") if path.is_file()}


def test_what_was_sent_one_way_is_not_kept(opening: Open) -> None:
    here, there = opening(), opening()
    inbox = Inbox()
    here.inlet(command(NAME), lambda payload: inbox.put(b""))
    outlet, large = there.outlet(command(NAME)), blob(there, bytes(1_000_000))

    def send() -> None:
        outlet.send(large, SOON)
        inbox.get(timeout=SOON)

    send()
    before = memory()
    for _ in range(100):
        send()
    assert memory() - before < 50_000_000


def test_what_ice_has_to_say_goes_to_our_log(opening: Open, caplog: pytest.LogCaptureFixture) -> None:
    here: Any = opening()
    before = set(threading.enumerate())
    here.communicator.getLogger().warning("something is odd")
    wait_until(lambda: "test: something is odd" in caplog.text)
    assert set(threading.enumerate()) <= before  # others may end


def test_properties_of_ices_own_hold_but_for_those_that_would_break_calls(opening: Open) -> None:
    here: Any = opening(properties={"Ice.ACM.Client.Timeout": "7", "Ice.Extra": "x"})
    properties = here.communicator.getProperties()
    found = [
        properties.getProperty(f"Ice.{name}") for name in ("ACM.Client.Timeout", "ThreadPool.Server.Size", "Extra")
    ]
    assert found == ["7", "1", "x"]
    with pytest.raises(ConfigurationError, match=r"`Ice\.ThreadPool\.Server\.Size` is 1"):
        opening(properties={"Ice.ThreadPool.Server.Size": "4"})


def test_a_second_server_is_refused_wherever_it_listens(opening: Open, endpoint: str) -> None:
    echoing(opening())
    with pytest.raises(AlreadyServed):
        echoing(opening(endpoints={"Conformance": endpoint}))
