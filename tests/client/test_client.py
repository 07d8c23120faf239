"""`connect`: a script takes part in a running network without anything that was generated for it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import subprocess
import sys
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from robocomp_py import connect
from robocomp_py.client import Connection
from robocomp_py.client.plotting import numbers_below, part_of, plot
from robocomp_py.client.session import NotThere
from robocomp_py.client.values import Record, Types, record
from robocomp_py.contract.types import FLOAT64, INT32, STRING, Enumeration, ExceptionType, Field, Sequence, Struct
from robocomp_py.deploy.place import Place
from robocomp_py.errors import (
    Busy,
    Cancelled,
    Closed,
    ConfigurationError,
    DeclaredError,
    DeploymentError,
    EncodeError,
    RemoteFailure,
    Timeout,
    Unreachable,
)
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.network import NotUnderstood
from robocomp_py.transports.base import find_transport

from ..runtime.components import MIDDLEWARES, Diary, Station
from ..runtime.running import make, running
from ..tools import talkers
from ..tools.talkers import Listener
from ..tools.terse import INTERFACE, terse
from .pilot import flying

TELLERS = [name for name in MIDDLEWARES if name != "inproc"]


class Talker(talkers.Talker):
    def Everything_work(self, task: str) -> str:
        if task == "fail":
            raise RuntimeError("it is broken")
        return task.upper()


@pytest.fixture(scope="module")
def talker() -> Iterator[Any]:
    with running(make(Talker, find_transport, "middleware=shm", name="talker")) as worker:
        yield worker


@pytest.fixture(scope="module")
def shared(talker: Any) -> Iterator[Connection]:
    with connect(middleware="shm") as net:
        yield net


@pytest.fixture
def net(shared: Connection) -> Any:
    return shared


@pytest.mark.parametrize("middleware", TELLERS)
def test_queries_commands_and_topics_work_over_every_middleware(middleware: str) -> None:
    with (
        running(make(Talker, find_transport, f"middleware={middleware}", name="orator")) as worker,
        connect(middleware=middleware) as net,
    ):
        everything = net.wait("orator/Everything", SOON)
        assert tuple(everything.divide(17, divisor=5)) == (3, 2)
        everything.poke(4)
        wait_until(lambda: "poked 4" in worker.entries)
        assert everything.latest().text == "hello"
        first, second = (message.number for message, _ in zip(everything, range(2), strict=False))
        assert second == first + 1
        with pytest.raises(DeclaredError, match="division by zero"):
            everything.divide(1, 0)


def test_contracts_that_nothing_announces_are_read_from_idsl_files(
    own_runtime_folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "Everything.idsl").write_text(INTERFACE)
    with terse() as publish:
        with connect(middleware="shm") as net, pytest.raises(NotUnderstood, match=r"connect\(include=DIR\)"):
            net.terse.Everything.divide(17, 5)
        for include in (tmp_path, [str(tmp_path / "nowhere"), tmp_path]):
            with connect(middleware="shm", include=include) as net:
                assert tuple(net.terse.Everything.divide(17, divisor=5)) == (3, 2)
                messages = net.terse.Everything.listen(SOON)
                publish(8, "goodbye")
                assert next(messages).text == "goodbye"
    assert [each.getMessage() for each in caplog.records] == [f"include: {tmp_path}/nowhere: there is no such folder"]


def test_values_have_the_types_that_are_announced(net: Any) -> None:
    echo = net.talker.Everything.echo_nested
    types = echo.types
    sent = types["Nested"](
        scalars=types["Scalars"](i8=-3, text="ß", colour=types["Colour"].green),
        points=[types["Point"](1.0, 2.0)],
        by_name={"here": types["Point"](3.0, 4.0)},
        by_colour={types["Colour"].ultraviolet: 0.5},
        rows=[[types["Point"](x=5.0)]],
    )
    received = echo(sent)
    assert received == sent
    assert type(received.points[0]) is types["Point"]
    assert received.scalars.colour.name == "green"
    assert [repr(types[each]) for each in ("Nested", "Colour")] == [
        "<class 'robocomp_py.client.Conformance.Nested'>",
        "<enum 'Colour'>",
    ]
    assert types["Colour"].__module__ == "robocomp_py.client"
    x, y = received.points[0]
    assert (x, y) == (1.0, 2.0)


def test_structs_may_be_written_as_dictionaries_and_enumerators_by_their_names(net: Any) -> None:
    nested = net.talker.Everything.echo_nested
    scalars = {each.name: 0 for each in nested.types["Scalars"].__contract__.fields}
    scalars |= {"flag": True, "text": "x", "colour": "ultraviolet"}
    empty: dict[str, Any] = {each.name: [] for each in nested.types["Nested"].__contract__.fields}
    given = empty | {"scalars": scalars, "points": [{"x": 1, "y": 2}, (3, 4)], "nothing": {}}
    received = nested(value=given | {"by_name": {"a": (0, 0)}, "by_number": {}, "by_colour": {"green": 1.0}})
    assert received.scalars.colour == -7
    assert [each.y for each in received.points] == [2.0, 4.0]
    assert [each.name for each in received.by_colour] == ["green"]


def test_numeric_sequences_are_arrays(net: Any) -> None:
    echo = net.talker.Everything.echo_arrays
    received = echo(echo.types["Arrays"](floats=[1, 2.5], octets=b"ab"))
    assert received.floats.dtype == np.float32
    assert received.floats.tolist() == [1.0, 2.5]
    assert bytes(received.octets) == b"ab"


def test_exceptions_have_the_class_and_the_fields_of_the_interface(net: Any) -> None:
    with pytest.raises(DeclaredError) as raised:
        net.talker.Everything.divide(1, 0)
    assert type(raised.value).__name__ == "Failed"
    assert traceback.format_exception_only(raised.value)[0].startswith("robocomp_py.client.Conformance.Failed: ")
    assert (raised.value.what, raised.value.code) == ("division by zero", 7)  # type: ignore[attr-defined]
    with pytest.raises(RemoteFailure, match="it is broken"):
        net.talker.Everything.work("fail")


@pytest.mark.parametrize(
    ("call", "kind", "why"),
    [
        (lambda e: e.divide(1), TypeError, "lacks `divisor`; it takes (dividend=0, divisor=0)"),
        (lambda e: e.divide(1, 2, 3), TypeError, "3 arguments are given"),
        (lambda e: e.divide(1, 2, dividend=3), TypeError, "`dividend` is given twice"),
        (lambda e: e.divide(dividend=1, diviser=2), TypeError, "did you mean `divisor`?"),
        (lambda e: e.divide(1, diviser=2), TypeError, "did you mean `divisor`? it takes (dividend=0, divisor=0)"),
        (lambda e: e.divide(1, "two"), EncodeError, "Conformance.Everything.divide: divisor must be an int from"),
        (lambda e: e.divide.latest(), AttributeError, "divide: query, which has no `latest`; use: …divide(dividend=0"),
        (lambda e: e(), TypeError, "talker/Everything is not an operation; it has "),
        (lambda e: e.divide(1, 2, deadline=0), ValueError, "must be a positive number of seconds"),
        (lambda e: e.divide(1, 2**63), EncodeError, "divisor must be an int from"),
        (lambda e: e.echo_nested({"scalers": 1}), EncodeError, "echo_nested: value: unknown field `scalers`; did"),
        (lambda e: e.echo_nested({"scalars": 1}), EncodeError, "value: lacks `points`"),
        (lambda e: e.echo_nested((1, 2)), EncodeError, "value: has 2 values; its fields are scalars"),
        (lambda e: e.news(1, "x"), TypeError, "is a topic: it is heard by .latest()"),
        (lambda e: e.echo_nested.types["Point"](z=1), TypeError, "Point: unknown field `z`"),
        (lambda e: e.echo_nested.types["Point"](1, x=1), TypeError, "`x` is given twice"),
        (lambda e: e.echo_nested.types["Point"](1, 2, 3), TypeError, "has 2 fields, not 3"),
        (lambda e: e.echo_nested.types["Point"]().z, AttributeError, "Point: unknown field `z`"),
        (lambda e: e.echo_nested.types["Point"]()["z"], KeyError, "Point: unknown field `z`"),
    ],
)
def test_what_is_wrong_is_told(net: Any, call: Any, kind: type[Exception], why: str) -> None:
    with pytest.raises(kind) as raised:
        call(net.talker.Everything)
    assert why in str(raised.value)


def test_names_that_are_not_there_are_told(net: Any) -> None:
    with pytest.raises(NotThere) as raised:
        net.talkr  # noqa: B018
    assert str(raised.value) == "`talkr` is not in what runs on this host; did you mean `talker`?"
    with pytest.raises(AttributeError, match="`divde` is not in talker/Everything; did you mean `divide`"):
        net.talker.Everything.divde(1, 2)
    with pytest.raises(AttributeError, match="`lates` is not in talker/Everything; did you mean `latest`"):
        net.talker.Everything.lates()
    with pytest.raises(KeyError):
        net["talker/Nothing"]
    with pytest.raises(TypeError, match="talker is not a topic"):
        iter(net.talker)
    assert not hasattr(net, "elephant")
    assert not hasattr(net, "_ipython_display_")


def test_names_are_completed_and_shown(net: Any) -> None:
    assert "talker" in dir(net)
    assert "Everything" in dir(net.talker)
    assert {"divide", "news", "latest"} <= set(dir(net.talker.Everything))
    assert "CommonBehavior" not in dir(net.talker)
    assert net.talker.CommonBehavior.getState().name
    assert "talker" in net
    assert "  talker  Everything" in repr(net).splitlines()
    assert "  divide       query" in repr(net.talker.Everything).splitlines()
    taught = repr(net.talker.Everything.divide)
    assert "int64 divide(int64 dividend, int64 divisor, out int64 remainder) throws Failed;" in taught
    assert "use: …divide(dividend=0, divisor=0)" in taught
    assert net.talker.Everything.divide.__doc__ == taught
    assert "<td><code>divide</code></td><td>query</td>" in net.talker.Everything._repr_html_()
    assert str(net.talker.Everything.divide.__signature__) == "(dividend, divisor)"


def test_a_network_with_a_namespace_is_found_by_its_name(own_runtime_folder: Path, tmp_path: Path) -> None:
    place = Place("tamed")
    place.take("a test")
    ours = {"station": {"channels": "robot1/station"}}
    place.leave_plan(json.dumps({"processes": [{"instances": ["station"]}], "ours": ours}))
    with (
        running(make(Station, find_transport, "middleware=shm", "namespace=robot1")),
        running(make(Diary, find_transport, "middleware=shm")),
        connect("tamed", middleware="shm", timeout=SOON) as net,
    ):
        assert "robot1" in net
        assert net.robot1.station.Everything.work("dig") == "dig"
        (tmp_path / "home.ddsl").write_text("Deployment tamed { };\n")
        with connect(tmp_path / "home.ddsl", middleware="shm", timeout=SOON) as by_file:
            assert repr(by_file).splitlines()[0] == "tamed:"
        with pytest.raises(DeploymentError, match=r"did you mean `.*home\.ddsl`"):
            connect(str(tmp_path / "hme.ddsl"))
    place.release()


def test_a_component_may_be_called_like_a_method() -> None:
    named = ("close", "wait", "lambda", "arm-left")
    started = [running(make(Talker, find_transport, "middleware=shm", name=each)) for each in named]
    for each in started:
        each.__enter__()
    try:
        with connect(middleware="shm") as net:
            for name in named:
                assert net[name]["Everything"].work("x") == "X"
                assert net[f"{name}/Everything/work"]("y") == "Y"
    finally:
        for each in started:
            each.__exit__(None, None, None)


def test_a_slow_script_drops_the_oldest_messages_and_counts_them(net: Any, talker: Any) -> None:
    messages = net.talker.Everything.listen(depth=2)
    reached = talker.number
    wait_until(lambda: talker.number > reached + 20)
    first, second = next(messages), next(messages)
    assert messages.dropped >= 10
    assert second.number == first.number + 1


def test_silence_is_told() -> None:
    with (
        running(make(Station, find_transport, "middleware=shm", name="silent")),
        connect(middleware="shm") as net,
    ):
        with pytest.raises(Timeout, match="silent/Everything/news: no message came"):
            net.silent.Everything.latest(0.1)
        with pytest.raises(Timeout):
            next(net.silent.Everything.listen(0.1))
        net.silent.Everything.poke(1)
        assert net.silent.Everything.latest().number == 1
        assert net.silent.Everything.latest(newer_than=SOON).number == 1
        with pytest.raises(Timeout):
            net.silent.Everything.latest(0.1, newer_than=0)


def drawn(net: Any, *fields: str, axes: Any) -> Any:
    """A plot of news, over a time in which there are some: a busy machine hears nothing in a short one."""
    seconds = 0.1
    while True:
        try:
            return net.talker.Everything.plot(*fields, seconds=seconds, axes=axes)
        except Timeout:
            assert seconds < SOON * 3
            seconds *= 4


def test_values_are_drawn(net: Any) -> None:
    from matplotlib.figure import Figure  # takes long: only the worker that runs this test needs it

    axes = Figure().subplots()
    assert drawn(net, "number", axes=axes) is axes
    (line,) = axes.lines
    assert (np.diff(line.get_ydata()) > 0).all()
    assert (axes.get_title(), axes.get_xlabel()) == ("talker/Everything/news", "seconds")
    every = drawn(net, axes=Figure().subplots())
    assert [each.get_label() for each in every.lines] == ["number"]
    for path, why in (
        ("text", "`text` is str, and only numbers"),
        ("numbr", "did you mean `number`"),
        ("a b", "no path"),
        ("rows[*].points[*].y", r"more than once; draw one of these arrays: rows\[0\]\.points\[\*\]\.y"),
    ):
        with pytest.raises((ValueError, AttributeError), match=why):
            drawn(net, path, axes=axes)


def test_a_curve_has_a_gap_where_a_message_has_too_few_items() -> None:
    from matplotlib.figure import Figure

    point = Struct("A::Point", (Field("name", STRING), Field("x", FLOAT64)))
    made: Any = record(point.name, point.fields).python
    scan: Any = record("A::Scan", (Field("points", Sequence(point)),)).python
    messages = [scan([]), scan([made("a", 1.0), made("b", 2.0)]), scan([made("a", 3.0)])]

    def drawn(*fields: str) -> Any:
        listening: Any = contextlib.nullcontext(messages)
        return plot("it", "", lambda _: listening, fields, 5.0, Figure().subplots())

    (line,) = drawn("points[0].x").lines
    assert np.array_equal(line.get_ydata(), [np.nan, 1.0, 3.0], equal_nan=True)
    for field, why in (
        ("points[2].x", r"`points\[2\]\.x` is in none of 3 messages: they have too few items"),
        ("points", r"`points` is a sequence without items, and only numbers"),
        (
            "points[*].name",
            r"`points\[\*\]\.name` is a sequence of str, and only numbers and arrays of them are drawn$",
        ),
    ):
        with pytest.raises(ValueError, match=why):
            drawn(field)
    del messages[0]
    with pytest.raises(ValueError, match=r"write a number of its items, as points\[\*\]\.x or points\[0\]\.x"):
        drawn("points")


def test_what_cannot_be_meant_is_refused_with_what_to_do(net: Any) -> None:
    with pytest.raises(AttributeError, match="talker: `gain` cannot be set; call an operation, or publish to a topic"):
        net.talker.gain = 3
    with pytest.raises(AttributeError, match="`talker` cannot be set"):
        net.talker = None
    # Other tests of this file may have started further components.
    with pytest.raises(TypeError, match=r"brackets take a name, as in .*, not 3; it has .*talker"):
        net[3]
    for wrong in (-1, float("nan")):
        with pytest.raises(ValueError, match="must be a number of seconds, or None"):
            net.talker.Everything.listen(wrong)


def test_a_part_of_a_message_is_found_by_its_path() -> None:
    inner: Any = record("A::B", (Field("x", FLOAT64),)).python
    assert part_of(inner(2.5), "x") == 2.5
    assert part_of(inner(2.5), "place.x", "place") == 2.5
    assert part_of(np.array([1, 2]), "scan[1]", "scan") == 2
    assert part_of([inner(1.0), inner(2.5)], "points[*].x", "points").tolist() == [1.0, 2.5]
    with pytest.raises(AttributeError, match=r"a sequence has no field `x`; its items may have: \[0\]\.x or \[\*\]\.x"):
        part_of([inner(1.0)], "points.x", "points")


def test_of_a_struct_its_numbers_are_drawn() -> None:
    inner = record("A::B", (Field("x", FLOAT64), Field("class", INT32)))
    outer: Any = record("A::C", (Field("name", STRING), Field("at", inner), Field("all", Sequence(inner)))).python
    assert numbers_below(outer(), "", "") == ["at.x", "at.class"]
    assert numbers_below(outer(), "place.at", "place") == ["place.at.x", "place.at.class"]
    assert part_of(outer(), "at.class") == 0
    with pytest.raises(ValueError, match="`it` is D, which has no numbers outside of sequences"):
        numbers_below(cast("Any", record("A::D", (Field("name", STRING),)).python)(), "it", "it")


def test_a_subscriber_hears_what_a_script_publishes() -> None:
    with (
        running(make(Listener, find_transport, "middleware=shm", name="listener")) as worker,
        connect(middleware="shm") as net,
    ):
        topic = net["phantom/Everything/news"]
        topic.publish(7, text="boo")
        wait_until(lambda: "7 boo" in worker.entries)


def test_several_threads_may_use_one_connection(net: Any) -> None:
    found: list[Any] = []

    def work(number: int) -> None:
        for _ in range(20):
            found.append(net.talker.Everything.divide(number, 1).ret == number)
        found.append(net.talker.Everything.latest().text == "hello")

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join(SOON)
    assert len(found) == 84
    assert all(found)


def test_a_closed_connection_says_so_and_leaves_nothing(talker: Any) -> None:
    before = set(threading.enumerate())
    net = connect(middleware="shm")
    divide, messages = net.talker.Everything.divide, net.talker.Everything.listen()
    divide(1, 1)
    net.close()
    net.close()
    assert set(threading.enumerate()) <= before  # others may end
    assert repr(net) == "network: the connection is closed"
    for use in (lambda: divide(1, 1), lambda: net.talker, lambda: net["talker"]):
        with pytest.raises(Closed):
            use()
    for _ in messages:
        pass  # those that waited; then it ends


def test_a_server_that_is_started_again_is_found(own_runtime_folder: Path) -> None:
    with connect_later() as opened:
        with running(make(Talker, find_transport, "middleware=shm", name="phoenix")):
            net = opened()
            assert net.phoenix.Everything.work("a") == "A"
        with pytest.raises((Unreachable, Timeout)):
            net.phoenix.Everything.work("b", deadline=0.2)
        with running(make(Talker, find_transport, "middleware=zeromq", name="phoenix")):
            wait_until(lambda: _works(net))


def _works(net: Any) -> bool:
    try:
        return bool(net.phoenix.Everything.work("c", deadline=0.5) == "C")
    except (Unreachable, Timeout, NotThere):
        return False


class connect_later:
    """A connection that is opened in a block and closed at the end of this one."""

    def __enter__(self) -> Any:
        self.made: list[Connection] = []
        return self._open

    def _open(self) -> Any:
        self.made.append(connect())
        return self.made[0]

    def __exit__(self, *_: object) -> None:
        for each in self.made:
            each.close()


def test_nothing_runs(own_runtime_folder: Path) -> None:
    with pytest.raises(NotThere, match="no component runs on this host"):
        connect(middleware="shm", timeout=0.1)
    with pytest.raises(NotThere, match="no network `rescue` runs on this host; start it with rcdeploy"):
        connect("rescue", timeout=0.1)
    with pytest.raises(ConfigurationError, match="inproc cannot tell what uses it"):
        connect(middleware="inproc")
    with pytest.raises(ConfigurationError, match="did you mean `shm`"):
        connect(middleware="shn")
    with pytest.raises(ConfigurationError, match="must be a positive number"):
        connect(timeout=0)


def test_a_wait_for_a_network_is_logged(own_runtime_folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(NotThere):
        connect("rescue", timeout=1.3)
    assert [each.getMessage() for each in caplog.records] == [
        "waiting up to 1.3 s: no network `rescue` runs on this host; start it with rcdeploy"
    ]


SCRIPT = """
from robocomp_py import connect
net = connect(middleware="shm")
print(net.talker.Everything.work("hello"), net.talker.Everything.latest().text)
"""


def test_a_script_that_does_not_close_ends_without_a_word(talker: Any) -> None:
    """And it needs nothing of the network."""
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=SOON * 3, cwd="/")
    assert (done.stdout, done.stderr, done.returncode) == ("HELLO hello\n", "", 0)


@pytest.mark.parametrize("middleware", TELLERS)
def test_an_interpreter_waits_for_a_connection_that_a_daemon_thread_uses(middleware: str) -> None:
    """Otherwise nothing closes it, and threads of zenoh abort the process when the interpreter ends."""
    before, found = set(threading.enumerate()), []

    def listen(net: Any) -> None:
        net.talker.Everything.latest(SOON)
        found.extend(set(threading.enumerate()) - before - {threading.current_thread()})

    with (
        running(make(Talker, find_transport, f"middleware={middleware}", name="talker")),
        connect(middleware=middleware) as net,
    ):
        before.update(threading.enumerate())
        thread = threading.Thread(target=listen, args=(net,), daemon=True)
        thread.start()
        thread.join()
    assert found
    assert not [each.name for each in found if each.daemon]


def test_connect_costs_nothing_until_it_is_used() -> None:
    code = "import robocomp_py, sys; print('robocomp_py.client' in sys.modules, 'connect' in dir(robocomp_py))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "False True\n"
    with pytest.raises(ImportError):
        from robocomp_py import disconnect  # type: ignore[attr-defined]  # noqa: F401


@pytest.fixture(scope="module")
def pilot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with flying(tmp_path_factory.mktemp("client")), connect(middleware="shm") as net:
        yield net.wait("pilot/Pilot", SOON)


def test_a_goal_has_a_result(pilot: Any) -> None:
    goal = pilot.fly({"x": 1, "y": 2}, steps=3)
    assert goal.result(SOON) == 3
    assert goal.status.name == "SUCCEEDED"


def test_a_goal_can_be_awaited(pilot: Any) -> None:
    async def results() -> list[Any]:
        first = await pilot.fly((1, 2), 2)
        return [first, await asyncio.wrap_future(pilot.fly((1, 2), 3).future())]

    assert asyncio.run(results()) == [2, 3]


def test_a_goal_has_feedback_and_can_be_cancelled(pilot: Any) -> None:
    goal = pilot.fly((1, 2), 100_000)
    wait_until(lambda: goal.feedback)
    assert goal.feedback.left > 0
    with pytest.raises(Timeout):
        goal.result(0.05)
    goal.cancel()
    with pytest.raises(Cancelled):
        goal.result(SOON)


def test_a_goal_ends_with_the_exception_of_the_interface(pilot: Any) -> None:
    with pytest.raises(DeclaredError, match="a bird") as raised:
        pilot.fly((-1, 0), 1).result(SOON)
    assert type(raised.value).__name__ == "Blocked"


def test_what_is_wrong_with_a_goal_is_told_under_the_name_of_its_action(pilot: Any) -> None:
    for wrong in (lambda: pilot.fly((1, 2)), lambda: pilot.fly((1, 2), "a"), lambda: pilot.fly.latest()):
        with pytest.raises((TypeError, EncodeError, AttributeError)) as raised:
            wrong()
        assert re.search(r"Pilot[./]fly: ", str(raised.value))


def test_a_server_that_leaves_is_told_under_the_name_of_its_action(own_runtime_folder: Path, tmp_path: Path) -> None:
    with contextlib.ExitStack() as end:
        with flying(tmp_path):
            pilot = end.enter_context(connect(middleware="shm")).wait("pilot/Pilot", SOON)
            goal = pilot.fly((1, 2), 100_000)
        for ask in (goal.result, lambda limit: pilot.fly((1, 2), 1, deadline=0.1).result(limit)):
            with pytest.raises((Unreachable, Timeout), match=r"Pilot[./]fly: "):
                ask(SOON)


def test_an_action_is_shown_as_one(pilot: Any) -> None:
    assert [each for each in dir(pilot) if each.startswith("fly")] == ["fly"]
    assert repr(pilot).splitlines() == ["pilot/Pilot:", "  fly  action"]
    taught = repr(pilot.fly)
    assert "[action] int32 fly(Place target, int32 steps) feedback(int32 left) throws Blocked;" in taught
    assert "goal = …fly(target={'x': 0.0, 'y': 0.0}, steps=0)" in taught


def test_goals_are_cancelled_when_the_script_ends(pilot: Any) -> None:
    with connect(middleware="shm") as net:
        net.pilot.Pilot.fly((1, 2), 100_000)
    wait_until(lambda: _can_fly(pilot))


def _can_fly(pilot: Any) -> bool:
    try:
        return bool(pilot.fly((1, 2), 1).result(SOON) == 1)
    except Busy:
        return False


def test_hostile_names_are_refused() -> None:
    for name in ("__init__", "a-b", "a::b"):
        with pytest.raises(NotUnderstood):
            record("A::B", (Field(name, INT32),))
    with pytest.raises(NotUnderstood):
        record("A::B", (Field("lambda", INT32), Field("lambda_", INT32)))
    with pytest.raises(NotUnderstood):
        Types()._exception(ExceptionType("A::B", (Field("args", INT32),)))
    for member in ("__new__", "mro", "_x_"):
        kind = Types()._type(Enumeration("E", ((member, 1),)))
        assert isinstance(kind, Enumeration)
        assert kind.python is None
    fields = (Field("class", INT32), Field("items", INT32), Field("_fields", INT32))
    made: Any = record("A::B", fields).python
    value = made(1, items=2, _fields=3)
    assert isinstance(value, Record)
    assert (value["class"], value.class_, value.items, value._fields) == (1, 1, 2, 3)
    assert isinstance(Types()._type(Struct("X", fields)), Struct)
