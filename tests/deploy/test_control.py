"""The socket at which a network is asked, from both ends; and who does not behave at it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.deploy import client
from robocomp_py.deploy.client import (
    Connection,
    NotRunning,
    ScoutLine,
    Stuck,
    chosen_lines,
    lines,
    network_of,
    networks,
)
from robocomp_py.deploy.control import BEHIND, CLIENTS, LINE, Control, read_request
from robocomp_py.deploy.events import EndRequested, RestartRequested, StopRequested
from robocomp_py.deploy.place import Place
from robocomp_py.deploy.policy import State
from robocomp_py.deploy.ring import MOST_LINES, Line, Ring
from robocomp_py.deploy.scouting import BEHIND as BEHIND_OF_SCOUTS
from robocomp_py.deploy.scouting import Scout
from robocomp_py.deploy.snapshot import HostStatus
from robocomp_py.deploy.sockets import listening
from robocomp_py.errors import DeploymentError, HostUnreachable
from robocomp_py.runtime.records import Record
from robocomp_py.testing.patience import SOON, wait_until

from ..crowd import crowded
from .networks import Standing, process, snapshot

NOW = 1_772_366_400.25


class Running:
    """A network with a control socket, on an event loop in a thread of its own."""

    def __init__(self, network: Standing, name: str = "home") -> None:
        self.network, self.ring, self.place = network, Ring(), Place(name)
        self.loop = asyncio.new_event_loop()
        self.complaints: list[dict[str, Any]] = []
        self.loop.set_exception_handler(lambda _, context: self.complaints.append(context))
        self._thread = threading.Thread(target=self.loop.run_forever)
        self._thread.start()
        self.place.take("a test")
        self._control = Control(network, self.ring)
        self.do(self._control.open(self.place.control))

    def do(self, what: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(what, self.loop).result(SOON)

    def call(self, deed: Callable[[], object]) -> None:
        """Have something done on the loop."""

        async def done() -> None:
            deed()

        self.do(done())

    def write(self, name: str, *texts: str) -> None:
        self.call(lambda: [self.ring.write(Line(NOW, name, text)) for text in texts])

    def close(self) -> None:
        if self.loop.is_closed():
            return
        self.do(self._control.close())
        self.do(self._settle())
        self.place.release()
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join()
        self.loop.close()
        assert self.complaints == []

    async def _settle(self) -> None:
        """Let asyncio close what it has been told to."""
        others = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.gather(*others, return_exceptions=True)
        for _ in range(5):
            await asyncio.sleep(0)


Start = Callable[..., Running]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts networks, which end with the test."""
    with contextlib.ExitStack() as ending:

        def started(*args: Any) -> Running:
            made = Running(*args)
            ending.callback(made.close)
            return made

        yield started


@pytest.fixture
def running(start: Start) -> Running:
    return start(Standing(process("laser"), process("left/arm"), process("left/wrist/joint", State.STARTING)))


def raw(running: Running) -> socket.socket:
    made = socket.socket(socket.AF_UNIX)
    made.settimeout(SOON)
    made.connect(str(running.place.control))
    return made


def test_the_reply_to_status_is_the_state_of_the_network(running: Running) -> None:
    with Connection("home") as connection:
        assert connection.status() == running.network.now


def test_several_ask_at_a_time_and_each_as_often_as_they_like(running: Running) -> None:
    with Connection("home") as one, Connection("home") as other:
        for _ in range(3):
            assert one.status() == other.status() == running.network.now


def test_what_does_not_run_cannot_be_asked() -> None:
    with pytest.raises(NotRunning, match="network `nowhere` is not running on this machine"):
        Connection("nowhere")


def test_for_a_misspelt_name_the_one_that_runs_is_proposed(running: Running) -> None:
    with pytest.raises(NotRunning, match="did you mean `home`"):
        Connection("hom")


def test_for_an_unlike_name_those_that_run_are_listed(running: Running) -> None:
    with pytest.raises(NotRunning, match="network `kitchen` is not running on this machine; running: home"):
        Connection("kitchen")


def test_running_processes_are_known_by_name(running: Running) -> None:
    assert networks() == ["home"]


def test_a_wish_to_stop_is_passed_on(running: Running) -> None:
    with Connection("home") as connection:
        connection.ask("down", grace=0.5)
    [event] = running.network.asked
    assert isinstance(event, StopRequested)
    assert (event.code, event.grace) == (0, 0.5)


def test_a_refusal_has_a_message(running: Running) -> None:
    running.network.refusal = "home is stopping: nothing can be started"
    with Connection("home") as connection:
        with pytest.raises(DeploymentError, match="nothing can be started"):
            connection.ask("restart", names=["laser"])
        assert connection.status(), "who was refused may go on asking"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"", "a request is a JSON object on a line"),
        (b"status", "a request is a JSON object on a line"),
        (b"\xff\xfe", "a request is a JSON object on a line"),
        (b"[" * 60000, "a request is a JSON object on a line"),
        (b"[]", 'a request is a JSON object with a key "do"'),
        (b'{"names": []}', 'a request is a JSON object with a key "do"'),
        (b'{"do": 1}', '"do" of a request is a word'),
        (b'{"do": "dance"}', "there is no request `dance`"),
        (
            b'{"do": "status", "who": 1}',
            'a request has no "who"; it may have: do, names, count, follow, mark, host, grace',
        ),
        (b'{"do": "restart", "names": "laser"}', '"names" of a request is a list of names'),
        (b'{"do": "restart", "names": [1]}', '"names" of a request is a list of names'),
        (b'{"do": "down", "grace": -1}', '"grace" of a request is a number of seconds'),
        (b'{"do": "down", "grace": 1' + b"0" * 400 + b"}", '"grace" of a request is a number of seconds'),
        (b'{"do": "down", "grace": NaN}', '"grace" of a request is a number of seconds'),
        (b'{"do": "down", "grace": true}', '"grace" of a request is a number of seconds'),
        (b'{"do": "logs", "count": 99999}', f'"count" of a request is a whole number up to {MOST_LINES}'),
        (b'{"do": "logs", "names": ["lasr"]}', "unknown instance `lasr`; did you mean `laser`?"),
    ],
)
def test_an_invalid_request_is_reported_and_the_next_one_is_answered(running: Running, line: bytes, says: str) -> None:
    with raw(running) as one, one.makefile("rb") as answers:
        one.sendall(line + b'\n{"do": "status"}\n')
        assert json.loads(answers.readline()) == {"error": says}
        assert "status" in json.loads(answers.readline())


def test_an_endless_request_is_refused(running: Running) -> None:
    with raw(running) as one, one.makefile("rb") as answers:
        one.sendall(b"x" * (2 * LINE))
        assert json.loads(answers.readline()) == {"error": f"a request has at most {LINE} bytes"}
        assert answers.readline() == b""


def test_a_request_may_come_in_pieces(running: Running) -> None:
    with raw(running) as one, one.makefile("rb") as answers:
        for byte in b'{"do": "status"}\n':
            one.sendall(bytes([byte]))
        assert "status" in json.loads(answers.readline())


def test_a_silent_client_does_not_keep_others_from_asking(running: Running) -> None:
    silent = [raw(running) for _ in range(CLIENTS + 5)]
    try:
        with Connection("home") as connection:
            assert connection.status()
        assert silent[0].recv(1) == b"", "who has been silent for longest had to go"
    finally:
        for each in silent:
            each.close()


@pytest.mark.parametrize("says", [b"", b'{"do": "status"}\n'], ids=["silent", "asking"])
def test_a_loop_that_keeps_connecting_hides_no_network_that_runs(running: Running, says: bytes) -> None:
    running.write("laser", "one")
    with crowded(running.place.control, 3 * CLIENTS, says, SOON):
        for _ in range(10):
            with Connection("home") as connection:
                assert connection.status() == running.network.now
                connection.ask("down", grace=0.5)
                assert [line.text for line in lines(connection, ["laser"], 1, follow=False)] == ["one"]
    assert len(running.network.asked) == 10, "no request is carried out twice"


def test_silent_connections_take_no_place_of_one_that_follows(running: Running) -> None:
    with Connection("home") as follower:
        told = lines(follower, ["laser"], 1, follow=True)
        running.write("laser", "before")
        assert next(told).text == "before"
        silent = [raw(running) for _ in range(2 * CLIENTS)]
        assert silent[CLIENTS - 2].recv(1) == b"", "silent ones make room for others"
        running.write("laser", "after")
        assert next(told).text == "after"
        for each in silent:
            each.close()


def test_a_connection_that_sends_no_request_is_closed(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocomp_py.deploy.control.SILENT_S", 0.05)
    with raw(running) as silent:
        assert silent.recv(1) == b""


@pytest.fixture
def closing() -> Iterator[Place]:
    """A network that runs, and closes each connection before it answers."""
    place = Place("home")
    place.take("a test")
    listener = listening(place.control)
    listener.setblocking(True)

    def close_each() -> None:
        with contextlib.suppress(OSError):
            while True:
                listener.accept()[0].close()

    thread = threading.Thread(target=close_each)
    thread.start()
    yield place
    listener.shutdown(socket.SHUT_RDWR)
    thread.join()
    listener.close()
    place.release()


def test_a_lost_connection_does_not_mean_that_the_network_ended(
    closing: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "AGAIN_S", 0.3)
    with Connection("home") as connection:
        with pytest.raises(Stuck, match=r"`home` runs \(process \d+\), but it closed the connection .* too many"):
            connection.status()
        with pytest.raises(Stuck, match="too many programs connect to"):
            client.down(connection, None, lambda there, all_of_them: None)
        with pytest.raises(Stuck, match="too many programs connect to"):
            list(lines(connection, [], 1, follow=True))


def test_a_client_that_does_not_read_is_disconnected(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocomp_py.deploy.control.SLOW_S", 0.1)
    running.write("laser", *("x" * 4096 for _ in range(16)))
    with raw(running) as one:
        one.sendall(b'{"do": "logs", "count": 16}\n' * 100)
        with Connection("home") as other:
            assert other.status(), "others are answered meanwhile"
        wait_until(lambda: is_cut(one))


def is_cut(one: socket.socket) -> bool:
    try:
        one.send(b"\n", socket.MSG_DONTWAIT)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return False


def test_the_socket_of_a_killed_network_does_not_stop_the_next_one(start: Start) -> None:
    place = Place("killed")
    place.folder.mkdir(mode=0o700, parents=True)
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(place.control))
    with pytest.raises(NotRunning):
        Connection("killed")
    again = start(Standing(process("laser")), "killed")
    with Connection("killed") as connection:
        assert connection.status()
    again.close()
    assert not place.folder.exists()


def test_a_runtime_folder_may_have_a_long_path(start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / ("long" * 30)
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(folder))
    start(Standing(process("laser")))
    with Connection("home") as connection:
        assert connection.status()


# Logs.


def test_the_last_lines_are_sent_in_the_order_of_arrival(running: Running) -> None:
    running.write("laser", "one", "two")
    running.write("left/arm", "three")
    running.write("laser", "four")
    last = [Line(NOW, "laser", "two"), Line(NOW, "left/arm", "three"), Line(NOW, "laser", "four")]
    with Connection("home") as connection:
        assert list(lines(connection, [], 3, follow=False)) == last
        assert list(lines(connection, ["left"], 10, follow=False)) == [Line(NOW, "left/arm", "three")]
        assert list(lines(connection, [], 0, follow=False)) == []


def test_the_deployer_has_lines_of_its_own(running: Running) -> None:
    running.write("laser", "one")
    running.write("rcdeploy", "all are ready")
    with Connection("home") as connection:
        assert list(lines(connection, ["rcdeploy"], 10, follow=False)) == [Line(NOW, "rcdeploy", "all are ready")]


def test_a_following_client_gets_lines_until_the_network_ends(start: Start) -> None:
    brief = start(Standing(process("laser"), process("arm")), "brief")
    brief.write("laser", "before")
    with Connection("brief") as connection:
        following = lines(connection, ["laser"], 10, follow=True)
        assert next(following) == Line(NOW, "laser", "before")
        brief.write("arm", "of somebody else")
        brief.write("laser", "after")
        assert next(following) == Line(NOW, "laser", "after")
        brief.close()
        assert list(following) == []


def test_of_chosen_lines_the_newest_and_the_new_ones_are_told(start: Start) -> None:
    brief = start(Standing(process("laser")), "brief")

    def errors(line: Line) -> bool:
        return line.level == "ERROR"

    brief.write("laser", *(f"{level}: {number}" for number in range(5) for level in ("ERROR", "INFO")))
    with Connection("brief") as connection:
        assert [line.text for line in chosen_lines(connection, [], 2, errors, follow=False)] == ["ERROR: 3", "ERROR: 4"]
        following = chosen_lines(connection, [], 1, errors, follow=True)
        assert next(following) == Line(NOW, "laser", "ERROR: 4")
        brief.write("laser", "INFO: 5", "ERROR: 5")
        assert next(following) == Line(NOW, "laser", "ERROR: 5")
        brief.close()
        assert list(following) == []


def test_a_record_is_told_with_its_fields(running: Running) -> None:
    record = Record(1.5, "ERROR", "left", "left", "compute", "w.py", 7, "failed\nValueError: no")
    line = Line(NOW, "laser", "ERROR: left: failed\nValueError: no", record)
    running.call(lambda: running.ring.write(line))
    with Connection("home") as connection:
        assert list(lines(connection, ["laser"], 1, follow=False)) == [line]


def test_a_slow_client_gets_the_number_of_lost_lines(running: Running) -> None:
    with Connection("home") as connection:
        running.write("laser", "before")
        following = lines(connection, [], 1, follow=True)
        assert next(following) == Line(NOW, "laser", "before")
        running.write("laser", *(str(number) for number in range(BEHIND + 7)))  # all of them before any is sent
        told = [next(following) for _ in range(BEHIND + 1)]
    assert told[-2] == Line(NOW, "laser", str(BEHIND - 1))
    assert told[-1][1:3] == ("", "(7 lines were lost: they came faster than they were read)")


def test_a_process_that_prints_much_keeps_the_lines_of_others() -> None:
    ring = Ring()
    ring.write(Line(NOW, "quiet", "once"))
    for number in range(5000):
        ring.write(Line(NOW, "noisy", str(number)))
    for number in range(100):
        ring.write(Line(NOW, "wordy", str(number) * 2048))
    assert ring.last(["quiet"], 10) == [Line(NOW, "quiet", "once")]
    assert ring.last([], 10000)[0] == Line(NOW, "quiet", "once")
    assert len(ring.last(["noisy"], 10000)) == 1000
    assert ring.last(["noisy"], 1) == [Line(NOW, "noisy", "4999")]
    assert sum(len(line.text) for line in ring.last(["wordy"], 10000)) <= 65536


# What takes its time.


def test_a_restart_is_over_when_all_are_ready_again(running: Running) -> None:
    running.network.now = snapshot(process("laser"), process("left/arm"), process("left/leg"))
    told: list[list[str]] = []
    steps = [
        (process("left/arm", starts=2), process("left/leg", State.RESTARTING, starts=2)),
        (process("left/arm", starts=2), process("left/leg", starts=3)),
    ]

    def tell(missing: list[str]) -> None:
        told.append(missing)
        running.network.now = snapshot(process("laser"), *steps[len(told) - 1])

    with Connection("home") as connection:
        done = client.restart(connection, ["left"], SOON, tell)
    assert [(each.name, each.starts) for each in done] == [("left/arm", 2), ("left/leg", 3)]
    assert running.network.asked == [RestartRequested(("left",))]
    assert told == [["left/arm", "left/leg"], ["left/leg"]]


def test_a_restart_that_fails_is_over_too(running: Running) -> None:
    def fail(missing: list[str]) -> None:
        running.network.now = snapshot(process("laser", State.FAILED, starts=2, how="ended with exit code 3"))

    with Connection("home") as connection:
        [done] = client.restart(connection, ["laser"], SOON, fail)
    assert (done.state, done.how) == (State.FAILED, "ended with exit code 3")


def test_a_restart_that_takes_too_long_is_not_waited_for(running: Running) -> None:
    with Connection("home") as connection, pytest.raises(Stuck, match="not ready after 0 s: laser; see: rcdeploy logs"):
        client.restart(connection, ["laser"], 0.0, lambda missing: None)


def test_nothing_is_started_again_on_a_host_that_is_out_of_reach(running: Running) -> None:
    host = HostStatus("onboard", "192.168.1.10", reachable=False, why="no route to host")
    running.network.now = snapshot(process("laser", State.LOST, host="onboard"), hosts=(host,))
    says = r"laser is on onboard \(192.168.1.10\), which is out of reach: no route to host"
    with Connection("home") as connection, pytest.raises(HostUnreachable, match=says):
        client.restart(connection, ["laser"], SOON, lambda missing: None)
    assert running.network.asked == []


def test_a_wish_to_stop_a_process_is_passed_on(running: Running) -> None:
    with Connection("home") as connection:
        connection.ask("stop", names=["laser"])
        assert running.network.asked == [EndRequested(("laser",))]
        with pytest.raises(DeploymentError, match='"down" stops all'):
            connection.ask("stop")


def test_a_stop_is_over_when_all_have_ended_and_says_what_had_ended_before(running: Running) -> None:
    running.network.now = snapshot(process("laser", State.FAILED), process("left/arm"), process("left/leg"))
    told: list[list[str]] = []
    steps = [(State.ENDED, State.STOPPING), (State.ENDED, State.ENDED)]

    def tell(there: list[str]) -> None:
        told.append(there)
        arm, leg = steps[len(told) - 1]
        running.network.now = snapshot(
            process("laser", State.FAILED), process("left/arm", arm), process("left/leg", leg)
        )

    with Connection("home") as connection:
        done, ended = client.stop(connection, ["left", "laser"], tell)
    assert [(each.name, each.state) for each in done] == [
        ("laser", State.FAILED), ("left/arm", State.ENDED), ("left/leg", State.ENDED)
    ]  # fmt: skip
    assert ended == ["laser"]
    assert running.network.asked == [EndRequested(("left", "laser"))]
    assert told == [["left/arm", "left/leg"], ["left/leg"]]


def test_nothing_is_stopped_on_a_host_that_is_out_of_reach(running: Running) -> None:
    host = HostStatus("onboard", "192.168.1.10", reachable=False, why="no route to host")
    running.network.now = snapshot(process("laser", State.LOST, host="onboard"), hosts=(host,))
    with Connection("home") as connection, pytest.raises(HostUnreachable, match="no route to host"):
        client.stop(connection, ["laser"], lambda there: None)
    assert running.network.asked == []


def test_a_network_is_down_when_nothing_of_it_is_left(start: Start) -> None:
    ending = start(Standing(process("laser"), process("arm")))
    told: list[tuple[int, int]] = []
    closing: list[threading.Thread] = []

    def tell(there: int, all_of_them: int) -> None:
        told.append((there, all_of_them))
        if there == 2:
            ending.network.now = snapshot(process("laser", State.STOPPING), process("arm", State.ENDED))
        else:
            closing.append(threading.Thread(target=ending.close))
            closing[0].start()

    with Connection("home") as connection:
        client.down(connection, None, tell)
    closing[0].join()
    assert told == [(2, 2), (1, 2)]
    assert Place("home").runner() is None


def test_a_controller_that_does_not_answer_is_not_waited_for(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "ANSWER_TIMEOUT_S", 0.05)
    goes_on = threading.Event()
    running.loop.call_soon_threadsafe(goes_on.wait, SOON)
    try:
        with (
            Connection("home") as connection,
            pytest.raises(Stuck, match=r"the process that runs network `home` \(process \d+\) does"),
        ):
            connection.status()
    finally:
        goes_on.set()
    monkeypatch.undo()
    with Connection("home") as connection:
        assert connection.status(), "it goes on"


# How networks are named.


@pytest.mark.parametrize(
    "text",
    [
        "Deployment Patrol { };",
        '// Deployment Old {\n/* Deployment Older { */ import "Deployment Wrong {.cdsl";\nDeployment   Patrol\n{',
        "Deployment Patrol { Component laser { this is half written",
    ],
)
def test_a_network_is_known_by_its_file_even_while_that_is_changed(tmp_path: Path, text: str) -> None:
    path = tmp_path / "net.ddsl"
    path.write_text(text)
    assert network_of(str(path)) == "Patrol"


def test_a_network_is_known_by_its_name() -> None:
    assert network_of("Patrol") == "Patrol"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "net.ddsl cannot be read: No such file or directory; give it a network"),
        ("Component arm { };", "net.ddsl is not a network: it has no `Deployment`"),
    ],
)
def test_a_file_that_is_not_a_network_is_reported(tmp_path: Path, text: str | None, says: str) -> None:
    path = tmp_path / "net.ddsl"
    if text is not None:
        path.write_text(text)
    with pytest.raises(DeploymentError, match=says):
        network_of(str(path))


def test_a_request_is_read_as_it_is_written() -> None:
    request = read_request(b'{"do": "logs", "names": ["laser"], "count": 5, "follow": true}')
    assert (request.do, request.names, request.count, request.follow) == ("logs", ("laser",), 5, True)


def test_lines_of_a_scout_and_its_tool_are_passed_on(running: Running) -> None:
    said: list[str] = []
    left = threading.Event()
    scout = Scout(said.append, left.set)
    running.network.scouts["base"] = lambda: scout
    line = ScoutLine("home", "base")
    try:
        line.say({"id": 1})
        wait_until(lambda: said == ['{"id": 1}'])
        running.call(lambda: scout.hear('{"id": 1, "end": true}'))
        assert line.told() == {"id": 1, "end": True}
        running.call(lambda: [scout.hear("{}") for _ in range(BEHIND_OF_SCOUTS + 3)])
        answers = [line.told() for _ in range(BEHIND_OF_SCOUTS + 1)]
        assert answers == [{}] * BEHIND_OF_SCOUTS + [{"dropped": 3}]
        running.call(lambda: scout.hear("nonsense"))
        with pytest.raises(DeploymentError, match="base: the answer of its scout is not understood"):
            line.told()
    finally:
        line.close()
        line.release()
    assert left.wait(SOON)


def test_a_tool_is_told_that_the_host_of_its_scout_is_lost(running: Running) -> None:
    scout = Scout(lambda line: None, lambda: None)
    running.network.scouts["base"] = lambda: scout
    line = ScoutLine("home", "base")
    running.call(lambda: scout.end("base is out of reach: its cable was cut", is_lost=True))
    with pytest.raises(HostUnreachable, match="its cable was cut"):
        line.told()
    line.release()
    with pytest.raises(HostUnreachable, match="robot is out of reach"):
        ScoutLine("home", "robot")
