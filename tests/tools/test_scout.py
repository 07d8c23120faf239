"""What a scout tells of its host, and what tools make of what several hosts tell."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import logging
import os
import queue
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.cli.common import UNREACHABLE, WRONG
from robocomp_py.cli.monitor import sight
from robocomp_py.contract.interface import Pattern
from robocomp_py.errors import HostUnreachable, Unreachable
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools import leases, scout
from robocomp_py.tools.absent import Absent
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import Seen, take_census
from robocomp_py.tools.doctor.elsewhere import left_there, places
from robocomp_py.tools.doctor.facts import Left, Machine, Process, Space
from robocomp_py.tools.far import Far, FarArrivals
from robocomp_py.tools.hosts import Hosts
from robocomp_py.tools.network import Channel, End
from robocomp_py.tools.posts import Post, ScoutError
from robocomp_py.tools.publishing import publish
from robocomp_py.tools.scout import LONGEST, Scout, parts_of
from robocomp_py.tools.survey import merged, survey, told_in
from robocomp_py.tools.tap import DEPTH, Found, Message, Seek, arrivals, tapped
from robocomp_py.tools.traffic import Arrival
from robocomp_py.transports.base import find_transport
from robocomp_py.transports.census import Told
from robocomp_py.transports.runtime_folder import runtime_dir

from ..client.pilot import flying
from ..runtime.components import Calculator, Tuned
from ..runtime.running import make, running
from . import elsewhere
from .commands import complained, heard, said
from .talkers import Listener, Talker
from .test_top import Asking

NOWHERE = Post("nowhere", lambda: Direct())


class Direct:
    """A connection to a scout in this process."""

    def __init__(self) -> None:
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.scout = Scout(self._answers.put)

    def say(self, message: Any) -> None:
        self.scout.ask(message)

    def told(self) -> Any:
        answer = self._answers.get()
        if isinstance(answer, Exception):
            raise answer
        return answer

    def end(self, error: Exception | None = None) -> None:
        self._answers.put(error)

    def close(self) -> None:
        self.end()

    def release(self) -> None:
        self.scout.close()


@pytest.fixture
def lines() -> list[Direct]:
    return []


@pytest.fixture
def post(lines: list[Direct]) -> Iterator[Post]:
    def connect() -> Direct:
        lines.append(Direct())
        return lines[-1]

    made = Post("base", connect)
    yield made
    made.close()


@pytest.fixture
def calculator() -> Iterator[None]:
    with running(make(Calculator, find_transport, "middleware=shm", name="sums")):
        wait_until(lambda: "sums/Everything/divide" in take_census(["shm"]).channels)
        yield


def end(owner: str, channel: str, pid: int = 1, middleware: str = "shm", host: str = "", text: str = "") -> End:
    return End(middleware, Told(owner, pid, "serves", channel, len(text), text), host)


@pytest.mark.usefixtures("calculator")
def test_a_scout_tells_what_a_census_on_its_host_finds(post: Post) -> None:
    seen, lost = survey([post], ["shm"])
    assert {each.told for each in seen.ends} == {each.told for each in take_census(["shm"], own=True).ends}
    assert {(each.host, each.via) for each in seen.ends} == {("base", post)}
    assert (lost, seen.troubles, seen.tellers) == ({}, [], {"base": frozenset(["shm"])})


def test_each_contract_is_sent_once_and_no_line_is_too_long() -> None:
    many = [end(f"arm{n}", f"arm{n}/Arm/move", text="x" * (n % 7 * 20_000)) for n in range(2000)]
    parts = list(parts_of(many))
    assert all(len(json.dumps(each)) < LONGEST for each in parts)
    assert sum(len(text) for each in parts for text in each["texts"].values()) == sum(range(7)) * 20_000
    assert [each.told for each in told_in(parts, NOWHERE)] == [each.told for each in many]


def test_ends_that_are_not_understood_are_left_out() -> None:
    good = ["shm", "arm", 7, "serves", "arm/Arm/move", 0, ""]
    answers: list[Any] = [{"ends": [good, 7, good[:-1], ["shm", None, *good[2:]]]}, {"ends": 7, "texts": [7]}, {}]
    assert [each.told.owner for each in told_in(answers, NOWHERE)] == ["arm"]


def test_a_question_that_is_not_known_is_an_error(post: Post) -> None:
    with pytest.raises(ScoutError, match="there is no question `dance`"):
        post.ask("dance", SOON)


def test_a_scout_that_ends_is_started_again_by_the_next_question(post: Post, lines: list[Direct]) -> None:
    answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
    with post.following("hear", answers.put, channels=[]):
        lines[0].end(HostUnreachable("its cable was cut"))
        with pytest.raises(HostUnreachable, match="its cable was cut"):
            raise answers.get(timeout=SOON)
    post.ask("census", SOON, middlewares=["shm"])
    assert len(lines) == 2


def test_hosts_that_cannot_be_asked_are_told(post: Post) -> None:
    def refuse() -> Any:
        raise HostUnreachable("its cable was cut")

    seen, lost = survey([Post("robot", refuse), post], ["shm"])
    assert lost == {"robot": "its cable was cut"}
    assert set(seen.tellers) == {"base"}


def test_what_two_hosts_tell_of_one_process_is_there_once() -> None:
    here = [end("arm", "arm/Arm/move", middleware="dds"), end("eye", "eye/Camera/look", middleware="shm")]
    there = [
        end("arm", "arm/Arm/move", middleware="dds", host="base"),
        end("eye", "eye/Camera/look", middleware="shm", host="base"),
    ]
    for ends, host in ((here, ""), (there, "base")):
        ends.append(end("stranger", "stranger/Arm/move", middleware="dds", host=host))
    found = merged(here, there, {"arm": "base", "eye": ""}, lambda name: name == "shm")
    assert [(each.told.owner, each.host) for each in found] == [
        ("arm", "base"),
        ("eye", ""),
        ("stranger", ""),
        ("eye", "base"),
    ]


def test_a_scout_reads_lines_and_ends_with_its_input() -> None:
    asked = [b"nonsense\n", b"7\n", b'{"id": 1, "do": "census", "middlewares": ["nothing"]}\n', b'{"do": "census"}\n']
    out = io.BytesIO()
    assert scout.main(io.BytesIO(b"".join(asked)), out) == 0
    answers = [json.loads(line) for line in out.getvalue().splitlines()]
    assert answers == [{"id": 1, "tellers": [], "troubles": []}, {"id": 1, "end": True}]


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_components_of_all_hosts_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base", sums="base"):
        found = [json.loads(line) for line in said(capsys, "list", "--middleware", "shm", "--json").splitlines()]
        assert [(each["owner"], each["host"], each["pid"]) for each in found] == [
            ("sums", "", os.getpid()),
            ("sums", "base", os.getpid()),
        ]
        shown = said(capsys, "list", "--middleware", "shm", "--host", "base", "--network", "home")
        assert [line.split()[:2] for line in shown.splitlines()] == [["component", "host"], ["sums", "base"]]


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_middlewares_are_opened_there_as_components_do(capsys: pytest.CaptureFixture[str]) -> None:
    one = ("run", "one", "--set", "transports.dds.domain=7", "--set", "transports.shm.depth=3")
    storm = "IceStorm/TopicManager:tcp -h 10.0.0.1 -p 9999"
    one += ("--set", f'transports.ice.storm="{storm}"', "--set", "transports.ice.message_size_max=9000000")
    with elsewhere.network("base", command=(*one, "+", *one), sums="base") as network:
        said(capsys, "list", "--middleware", "shm", "--host", "base")
        assert json.loads(network.questions[0])["options"] == {
            "dds": {"domain": 7},
            "ice": {"storm": storm, "host": "base"},
        }


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_the_exit_status_tells_that_a_host_is_out_of_reach(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base") as network:
        network.standing.scouts.clear()
        assert rc.main(["list", "--middleware", "shm"]) == UNREACHABLE
        shown = capsys.readouterr()
        assert "sums" in shown.out
        assert shown.err == "warning: base is out of reach: its cable was cut\n"


@pytest.mark.usefixtures("own_runtime_folder")
def test_a_wrong_name_of_a_host_or_a_network_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["list", "--host", "base"]) == WRONG
    assert "no network with other hosts runs here" in capsys.readouterr().err
    with elsewhere.network("base"):
        assert rc.main(["list", "--host", "vase"]) == WRONG
        assert "did you mean 'base'" in capsys.readouterr().err.replace("`", "'")
        assert rc.main(["list", "--network", "work"]) == WRONG
        assert "network `work` is not running" in capsys.readouterr().err


@pytest.mark.usefixtures("own_runtime_folder")
def test_keys_that_are_not_those_of_an_operator_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["list", "--keys", str(tmp_path)]) == WRONG
    assert "make them: rcdeploy keys NET.ddsl --operator" in capsys.readouterr().err
    (tmp_path / "operator@").mkdir()
    (tmp_path / "operator@" / "certificate.pem").touch()
    assert rc.main(["list", "--keys", str(tmp_path)]) == WRONG
    assert "no network that needs an operator runs here" in capsys.readouterr().err


@pytest.fixture
def talker(own_runtime_folder: Any) -> Iterator[Any]:
    with running(make(Talker, find_transport, "middleware=shm", name="talker")) as worker:
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        yield worker


THERE = ("--middleware", "shm", "--host", "base")


@pytest.mark.usefixtures("talker")
def test_topics_of_another_host_are_printed_and_measured(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base"):
        found = [json.loads(line) for line in said(capsys, "echo", "news", *THERE, "-n", "3", "--json").splitlines()]
        numbers = [each["message"]["number"] for each in found]
        assert numbers == list(range(numbers[0], numbers[0] + 3))
        assert {each["channel"] for each in found} == {"talker/Everything/news"}

        def measured(command: str) -> dict[str, Any]:
            lines = heard(capsys, command, "news", *THERE, "--json", seconds=1.2).splitlines()
            return dict(json.loads(lines[-1]))

        def is_complete(rate: dict[str, Any]) -> bool:
            return bool(rate["hz"] and rate["hz"] > 1 and rate["missing"] == 0)

        wait_until(lambda: is_complete(measured("hz")))  # a busy machine may hear few messages at first, or lose some
        aged = measured("delay")
        assert 0 < aged["median_s"] < SOON
        assert aged["one_clock"]


def echoed(capsys: pytest.CaptureFixture[str], *words: str, of: Callable[[str], str], many: int) -> list[str]:
    """The lines of `rc echo`, until so many origins are among them: on a busy machine, some come later than others."""
    most, found = 60, list[str]()
    while len(set(map(of, found))) < many:
        assert most < 100_000
        found = said(capsys, "echo", "news", *words, "-n", str(most)).splitlines()
        most *= 4
    return found


@pytest.mark.usefixtures("talker")
def test_publishers_of_one_name_are_heard_on_all_hosts(capsys: pytest.CaptureFixture[str]) -> None:
    over = ("--middleware", "shm")
    with elsewhere.network("base", "robot"):
        lines = echoed(capsys, *over, "--json", of=lambda line: str(json.loads(line)["host"]), many=3)
        found = list(map(json.loads, lines))
        assert {(each["channel"], each["host"]) for each in found} == {
            ("talker/Everything/news", host) for host in ("", "base", "robot")
        }
        for host in ("", "base", "robot"):
            numbers = [each["message"]["number"] for each in found if each["host"] == host]
            assert numbers == sorted(set(numbers))
        shown = echoed(capsys, *over, of=lambda line: line.split()[1], many=3)
        assert {line.split()[1] for line in shown} == {"here", "base", "robot"}
        rows = echoed(capsys, *over, "--csv", of=lambda line: line.split(",")[1], many=4)
        assert rows[0] == "time,host,number,text"
        assert {row.split(",")[1] for row in rows[1:]} == {"here", "base", "robot"}


@pytest.mark.usefixtures("talker")
def test_each_host_of_a_topic_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    def lines(*words: str, seconds: float = 1.2) -> list[str]:
        """What is told, for a time in which both hosts are told of: on a busy machine, that is longer."""
        found = heard(capsys, *words, "news", "--middleware", "shm", seconds=seconds).splitlines()
        is_enough = sum("base" in each for each in found) not in (0, len(found)) or seconds > 3 * SOON
        return found if is_enough else lines(*words, seconds=4 * seconds)

    with elsewhere.network("base"):
        measured = [json.loads(each) for each in lines("delay", "--json")]
        assert {(each["channel"], each["host"], each["one_clock"]) for each in measured} == {
            ("talker/Everything/news", "", True),
            ("talker/Everything/news", "base", True),
        }
        assert {each.partition(": ")[0] for each in lines("hz")} == {
            "talker/Everything/news over shm",
            "talker/Everything/news over shm of base",
        }


def test_a_topic_is_heard_over_all_middlewares_of_its_publishers(
    own_runtime_folder: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    over = ("--middleware", "shm", "--middleware", "zeromq")
    with (
        elsewhere.apart(own_runtime_folder, "tests.tools.there"),
        running(make(Talker, find_transport, "middleware=zeromq", name="talker")) as worker,
    ):
        worker.texts = ("over zeromq",)
        wait_until(lambda: len(take_census(["shm", "zeromq"]).topic("news").providers) == 2)
        with elsewhere.network("base"):
            for host in ("here", "base"):
                words = (*over, "--host", host, "--json")
                lines = echoed(capsys, *words, of=lambda line: str(json.loads(line)["message"]["text"]), many=2)
                assert {json.loads(each)["message"]["text"] for each in lines} == {"hello", "over zeromq"}
            measured = heard(capsys, "hz", "news", *over, "--host", "base", "--json", seconds=1.2)
            assert {json.loads(each)["middleware"] for each in measured.splitlines()} == {"shm, zeromq"}


def test_what_several_hosts_serve_under_one_name_is_not_called_by_chance(
    own_runtime_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base, several = own_runtime_folder / "base", "is served on base and this machine; choose one with --host base"
    divide = ("call", "talker/Everything/divide", "dividend=9", "divisor=4")
    with (
        elsewhere.apart(base, "tests.tools.there"),
        elsewhere.network("base", folder=base),
        running(make(Talker, find_transport, "middleware=shm", name="talker")),
    ):
        wait_until(lambda: "talker/Everything/divide" in take_census(["shm"]).channels)
        over = ("--middleware", "shm")
        assert complained(capsys, *divide, *over) == f"rc call: talker/Everything/divide {several}\n"
        assert complained(capsys, "log", "talker", "error", *over) == f"rc log: talker {several}\n"
        assert complained(capsys, "param", "list", "talker", *over) == f"rc param list: talker {several}\n"
        for host in ("base", "here"):
            assert json.loads(said(capsys, *divide, *over, "--host", host)) == {"ret": 2, "remainder": 1}
        with Hosts(None, pytest.fail) as hosts, Access() as access:
            census = partial(hosts.renew().census, ["shm"], own=True)
            with leases.told(access, census, ["talker"], "called", SOON) as told:
                assert ({each.host for each in told.topics}, told.silent) == ({"", "base"}, {})


def test_when_one_of_several_hosts_is_lost_the_others_are_heard_until_it_is_back(
    talker: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    complaints = io.StringIO()
    with elsewhere.network("base") as network:

        def cut_once_it_listens() -> None:
            scouts = dict(network.standing.scouts)
            wait_until(lambda: any('"hear"' in each for each in network.questions))
            network.standing.scouts.clear()
            network.cut()
            wait_until(lambda: "the others go on" in complaints.getvalue())
            network.standing.scouts |= scouts
            wait_until(lambda: "is heard again" in complaints.getvalue())
            talker.texts = ("late",)

        cut = threading.Thread(target=cut_once_it_listens)
        cut.start()
        words = ("echo", "news", "--middleware", "shm", "--where", "text=late", "-n", "1", "--json")
        try:
            with contextlib.redirect_stderr(complaints):
                assert rc.main(list(words)) == UNREACHABLE
        finally:
            cut.join()
    assert json.loads(capsys.readouterr().out)["message"]["text"] == "late"
    assert complaints.getvalue() == (
        "rc echo: base is out of reach: its cable was cut; the others go on\nrc echo: base is heard again\n"
    )


def test_what_a_terminal_cannot_take_is_dropped_and_counted_and_no_publisher_waits(talker: Any, post: Post) -> None:
    told = Told("talker", os.getpid(), "publishes", "talker/Everything/news", e.news.fingerprint, e.news.text)
    there = Channel("talker/Everything/news", Pattern.PUBLISH, [End("shm", told, "base", post)])
    with contextlib.closing(tapped([there], first=SOON, whole=SOON)) as heard:
        first = next(each for each in heard if isinstance(each, Message))
        until = talker.number + 3 * DEPTH
        wait_until(lambda: talker.number > until)  # meanwhile nothing takes them
        found = [first]
        while found[-1].message["number"] <= until:
            found.append(next(each for each in heard if isinstance(each, Message)))
    dropped = sum(each.dropped for each in found)
    assert dropped > DEPTH
    assert found[-1].message["number"] - found[0].message["number"] + 1 == len(found) + dropped


def test_intervals_on_another_host_are_those_of_its_clock() -> None:
    class Slow:
        """A scout whose first answer comes late."""

        host = "base"

        @contextlib.contextmanager
        def following(self, do: str, take: Any, **more: Any) -> Iterator[None]:
            for number, (at, late) in enumerate([(7.0, 5.0), (7.02, 0.0)], 1):
                arrival = ["talker/Everything/news", at, 8, 1, number, None]
                take({"arrivals": [arrival], "now": time.monotonic() - 50 - late})
            yield

    taken: list[Arrival] = []
    slow: Any = Slow()
    topic = Channel("talker/Everything/news", Pattern.PUBLISH, [end("talker", "talker/Everything/news")])
    with FarArrivals(taken.append).following(slow, [topic]):
        first, second = taken
    assert second.at - first.at == pytest.approx(0.02)
    assert {each.host for each in taken} == {"base"}


@pytest.mark.usefixtures("talker")
def test_a_host_that_is_out_of_reach_is_told_while_others_are_heard(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base", "robot") as network:
        del network.standing.scouts["base"]
        assert rc.main(["echo", "news", "-n", "1", "--middleware", "shm"]) == UNREACHABLE
        shown = capsys.readouterr()
        assert shown.err == "warning: base is out of reach: its cable was cut\n"
        assert shown.out


def test_a_host_that_was_out_of_reach_from_the_beginning_is_heard_once_it_is_there(
    talker: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    complaints = io.StringIO()
    with elsewhere.network("base") as network:
        scouts = dict(network.standing.scouts)
        network.standing.scouts.clear()

        def come_back() -> None:
            wait_until(lambda: "base is out of reach" in complaints.getvalue())
            network.standing.scouts |= scouts
            wait_until(lambda: "rc echo: base is heard now" in complaints.getvalue())
            talker.texts = ("late",)

        coming = threading.Thread(target=come_back)
        coming.start()
        words = ("--where", "text=late", "-n", "40", "--json", "--middleware", "shm")
        try:
            with contextlib.redirect_stderr(complaints):
                assert rc.main(["echo", "news", *words]) == UNREACHABLE
        finally:
            coming.join()
    lines = map(json.loads, capsys.readouterr().out.splitlines())
    assert {each["host"] for each in lines} == {"", "base"}


@pytest.mark.usefixtures("talker")
def test_a_host_that_was_out_of_reach_from_the_beginning_is_measured_once_it_is_there(post: Post) -> None:
    here = take_census(["shm"]).channels["talker/Everything/news"]
    there = Channel(here.name, Pattern.PUBLISH, [replace(each, host="base", via=post) for each in here.providers])
    now = iter([0.0])
    absent = Absent(["base"], lambda: next(now, 10.0))
    told = list[Any]()
    with contextlib.closing(
        arrivals([here], first=SOON, whole=None, seek=Seek(absent, lambda: ([there], ())))
    ) as heard:
        for each in heard:
            told.append(each)
            if isinstance(each, Arrival) and each.host == "base":
                break
    (found,) = (each for each in told if isinstance(each, Found))
    assert [each.host for each in found.topics] == ["base"]
    assert not absent


@pytest.mark.usefixtures("talker")
def test_a_command_that_listens_ends_when_the_host_is_lost(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base") as network:

        def cut_once_it_listens() -> None:
            wait_until(lambda: any('"hear"' in each for each in network.questions))
            network.cut()

        cut = threading.Thread(target=cut_once_it_listens)
        cut.start()
        try:
            assert rc.main(["echo", "news", *THERE]) == UNREACHABLE
        finally:
            cut.join()
        assert capsys.readouterr().err == "rc echo: base is out of reach: its cable was cut\n"


@pytest.mark.usefixtures("talker")
def test_a_name_that_may_be_on_a_lost_host_is_told_so(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base") as network:
        network.standing.scouts.clear()
        assert rc.main(["hz", "Laser", "--middleware", "shm", "--timeout", "0.1"]) == UNREACHABLE
        assert "it may be on base" in capsys.readouterr().err


@pytest.mark.parametrize("full", [True, False])
def test_messages_are_shortened_there_unless_all_is_wanted(talker: Any, post: Post, full: bool) -> None:
    talker.texts = ("x" * 300,)
    heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
    with post.following("hear", heard.put, channels=["talker/Everything/news"], full=full):
        wait_until(lambda: "message" in (told := heard.get(timeout=SOON)) and "x" in told["message"][1]["text"])
        text = heard.get(timeout=SOON)["message"][1]["text"]
    assert (text == "x" * 300) is full


def test_a_message_that_is_too_long_for_a_line_is_replaced_by_the_reason(talker: Any, post: Post) -> None:
    talker.texts = ("x" * LONGEST,)
    heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
    with post.following("hear", heard.put, channels=["talker/Everything/news"], full=True):
        wait_until(lambda: "not sent to another host" in str(heard.get(timeout=SOON)))


def test_that_a_publisher_ends_is_told(own_runtime_folder: Any, post: Post) -> None:
    heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
    with contextlib.ExitStack() as ends:
        with running(make(Talker, find_transport, "middleware=shm", name="talker")):
            wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
            ends.enter_context(post.following("hear", heard.put, channels=["talker/Everything/news"]))
            wait_until(lambda: "message" in heard.get(timeout=SOON))
        wait_until(lambda: heard.get(timeout=SOON).get("presence") == ["talker/Everything/news", False])


def test_answers_that_are_not_understood_are_ignored() -> None:
    taken: list[Any] = []
    far = Far(lambda channel, message: taken.append(message.message), taken.append)
    there = Post("base", Direct)
    with far.following(there, [Channel("a/B/c", Pattern.PUBLISH, [end("a", "a/B/c")])]):
        answers: list[Any] = [{}, {"message": 7}, {"message": ["x/B/c", 1, 0, None, None]}, {"presence": ["a/B/c", 7]}]
        for each in (*answers, {"message": ["a/B/c", 5, 0, None, None]}, {"dropped": 3}):
            far._answer("base", each)
    assert taken == [5, 3]


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_queries_of_another_host_are_called(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base"):
        divide = ("call", "sums/Everything/divide", "dividend=9")
        assert json.loads(said(capsys, *divide, "divisor=4", *THERE)) == {"ret": 2, "remainder": 1}
        assert "division by zero" in complained(capsys, *divide, "divisor=0", *THERE)
        assert "lacks `divisor`" in complained(capsys, *divide, *THERE, code=WRONG)


@pytest.mark.usefixtures("talker")
def test_commands_are_sent_to_another_host(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base"):
        said(capsys, "call", "talker/Everything/poke", "number=7", *THERE)
        wait_until(lambda: "poked 7" in talker.entries)


def test_calls_that_fail_there_have_the_reason_of_their_scout(post: Post) -> None:
    with pytest.raises(ScoutError, match="no component serves sums/Everything/divide"):
        post.ask("call", SOON, channel="sums/Everything/divide", middlewares=["shm"], arguments={}, within=1)
    with pytest.raises(ScoutError, match="channel"):
        post.ask("call", SOON, middlewares=["shm"])


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_components_of_another_host_are_measured(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base"):
        (one,) = map(json.loads, said(capsys, "top", "sums", "--once", "--json", *THERE).splitlines())
        assert (one["component"], one["host"], one["pid"]) == ("sums", "base", os.getpid())
        heads, row, *_ = said(capsys, "top", "--once", *THERE).splitlines()
        assert heads.split()[:3] == ["component", "host", "state"]
        assert row.split()[:3] == ["sums", "base", "compute"]


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_the_contract_of_another_host_is_shown_and_its_log_is_set(capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base"):
        assert "served by sums (process" in (shown := said(capsys, "info", "sums/Everything/divide", *THERE))
        assert " on base) over shm" in shown
        said(capsys, "log", "sums", "error", "--logger", "robocomp.of.another.host", *THERE)
        assert logging.getLogger("robocomp.of.another.host").level == logging.ERROR


def test_parameters_of_another_host_are_changed(own_runtime_folder: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with (
        elsewhere.network("base"),
        running(make(Tuned, find_transport, "middleware=shm", "params.device=here")) as tuned,
    ):
        said(capsys, "param", "set", "tuned", "max_speed=1.5", *THERE)
        assert tuned.params.max_speed == 1.5
        assert "1.5" in said(capsys, "param", "get", "tuned", "max_speed", *THERE)
        assert "allowed" in complained(capsys, "param", "set", "tuned", "max_speed=1000", *THERE)


def test_calls_of_another_host_are_printed(own_runtime_folder: Any, capsys: pytest.CaptureFixture[str]) -> None:
    over = ("middleware=shm", "namespace=desk")
    with (
        elsewhere.network("base"),
        running(make(Calculator, find_transport, *over)),
        running(make(Asking, find_transport, *over, name="pupil")),
    ):
        told = json.loads(said(capsys, "echo", "--calls", "divide", *THERE, "-n", "1", "--json"))
        assert told["caller"] == "desk/pupil"


def test_messages_are_published_on_another_host(own_runtime_folder: Any, capsys: pytest.CaptureFixture[str]) -> None:
    with (
        elsewhere.network("base"),
        running(make(Listener, find_transport, "middleware=shm", name="listener")) as worker,
    ):
        wait_until(lambda: any(each.uses for each in take_census(["shm"]).components()))
        said(capsys, "pub", "phantom/Everything/news", "number=7", "text=boo", *THERE)
        wait_until(lambda: "7 boo" in worker.entries)
        said(capsys, "pub", "phantom/Everything/news", "number=8", "text=a", "-n", "3", "--rate", "100", *THERE)
        wait_until(lambda: worker.entries.count("8 a") == 3)
        assert "no field `size`" in complained(capsys, "pub", "phantom/Everything/news", "size=8", *THERE, code=WRONG)


def test_each_subscriber_of_all_hosts_gets_a_message_once() -> None:
    there = [Post(name, lambda: Direct()) for name in ("base", "robot")]

    def heard(owner: str, middleware: str, via: Post | None = None) -> End:
        told = Told(owner, 1, "subscribes", "arm/Arm/moved", 0, "")
        return End(middleware, told, via.host if via else "", via)

    ends = [heard("eye", "shm"), heard("eye", "dds"), heard("ear", "dds"), heard("map", "shm", there[0])]
    ends += [heard("map", "zeromq", there[0]), heard("arm", "shm", there[1])]
    ways = [(each.middleware, each.via) for each in Channel("arm/Arm/moved", Pattern.PUBLISH, ends).ways]
    assert ways == [("shm", None), ("dds", None), ("shm", there[0]), ("shm", there[1])]


def test_a_subscriber_of_another_host_that_is_gone_is_told(own_runtime_folder: Any, post: Post) -> None:
    told = Told("ear", 1, "subscribes", "talker/Everything/news", e.news.fingerprint, e.news.text)
    gone = Channel("talker/Everything/news", Pattern.PUBLISH, [End("shm", told, "base", post)])
    with Access() as access, pytest.raises(ScoutError, match="`talker/Everything/news` is not there"):
        publish(access, gone, (7, "boo"), 1.0)
    with running(make(Talker, find_transport, "middleware=shm", name="talker")):
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        with Access() as access, pytest.raises(Unreachable, match="nothing subscribes to talker/Everything/news"):
            publish(access, gone, (7, "boo"), 1.0)


def test_a_link_on_another_host_is_kept_for_the_next_message(own_runtime_folder: Any, post: Post) -> None:
    def publishers() -> list[End]:
        channel = take_census(["shm"]).channels.get("phantom/Everything/news")
        return channel.providers if channel else []

    told = Told("listener", 1, "subscribes", "phantom/Everything/news", e.news.fingerprint, e.news.text)
    topic = Channel("phantom/Everything/news", Pattern.PUBLISH, [End("shm", told, "base", post)])
    with running(make(Listener, find_transport, "middleware=shm", name="listener")) as worker, Access() as access:
        wait_until(lambda: any(each.uses for each in take_census(["shm"]).components()))
        publish(access, topic, (1, "once"), SOON)
        assert publishers() == []
        for number in (2, 3):
            publish(access, topic, (number, "kept"), SOON, keep=True)
            (kept,) = publishers()
            assert kept.told.owner == "rc"
        wait_until(lambda: {"2 kept", "3 kept"} <= set(worker.entries))


def test_a_message_is_latched_on_another_host_until_its_end(own_runtime_folder: Any, post: Post) -> None:
    over = threading.Event()
    with running(make(Talker, find_transport, "middleware=shm", name="talker")), Access() as access:
        wait_until(lambda: "talker/Everything/news" in take_census(["shm"]).channels)
        told = Told("talker", 1, "publishes", "talker/Everything/news", e.news.fingerprint, e.news.text)
        topic = Channel("talker/Everything/news", Pattern.PUBLISH, [End("shm", told, "base", post)])
        keeping = threading.Thread(
            target=publish, args=(access, topic, (-7, "map"), SOON), kwargs={"latched": True, "over": over}
        )
        keeping.start()
        try:
            wait_until(lambda: len(take_census(["shm"]).topic("talker/Everything/news").providers) == 2)
        finally:
            over.set()
            keeping.join(SOON)
        wait_until(lambda: len(take_census(["shm"]).topic("talker/Everything/news").providers) == 1)


def test_goals_of_another_host_are_sent_and_cancelled(
    own_runtime_folder: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fly = ("fly", "target.x=1", "target.y=2")
    with flying(tmp_path), elsewhere.network("base"):
        capsys.readouterr()
        assert json.loads(said(capsys, "action", "list", "--json", *THERE))["action"] == "pilot/Pilot/fly"
        lines = said(capsys, "action", "send", *fly, "steps=100", *THERE).splitlines()
        assert lines[0].endswith(" of pilot/Pilot/fly: accepted")
        assert lines[-1] == "SUCCEEDED 100"
        assert any(line.startswith("feedback") for line in lines)
        assert complained(capsys, "action", "send", "fly", "target.x=-1", "target.y=2", "steps=3", *THERE) == (
            'rc action send: RoboCompPilot.Blocked: {"by": "a bird"}\n'
        )
        goal = said(capsys, "action", "send", *fly, "steps=100000", "--detach", *THERE).split()[1]
        wait_until(lambda: "EXECUTING" in said(capsys, "action", "info", "fly", *THERE))
        assert said(capsys, "action", "cancel", "fly", goal, *THERE).startswith(f"fly {goal}: CANCEL")


def test_a_goal_ends_when_its_host_is_lost(
    own_runtime_folder: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with flying(tmp_path), elsewhere.network("base") as network:
        capsys.readouterr()

        def cut_once_it_goes() -> None:
            wait_until(lambda: any("fly-result" in each for each in network.questions))
            network.cut()

        cut = threading.Thread(target=cut_once_it_goes)
        cut.start()
        try:
            assert rc.main(["action", "send", "fly", "target.x=1", "target.y=2", "steps=100000", *THERE]) == UNREACHABLE
        finally:
            cut.join()
        assert capsys.readouterr().err == "rc action send: base is out of reach: its cable was cut\n"


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_the_doctor_looks_at_all_hosts(capsys: pytest.CaptureFixture[str]) -> None:
    over = ("doctor", "--middleware", "shm")
    ended = subprocess.Popen(["true"])
    ended.wait()

    def checked(*checks: str, code: int = 1) -> list[tuple[str, str]]:
        found = map(json.loads, said(capsys, *over, "--json", *checks, code=code).splitlines())
        return [(each["host"], each["text"]) for each in found]

    def leave() -> None:
        """What a killed process leaves, and what the next one over this middleware removes."""
        (runtime_dir("shm") / f"{ended.pid}-0.json").write_text("{}")

    with elsewhere.network("base", sums="base", gone="base") as network:
        leave()
        left = "killed processes have left 1 entry or socket of shm"
        assert checked("--check", "leftovers", "--check", "clocks") == [("", left), ("base", left)]
        leave()
        advice = said(capsys, *over, "--check", "leftovers", "--host", "base", code=1)
        assert advice == f"warn   base: {left}: on base: none is in use; the next component over shm removes them\n"
        assert checked("--check", "plan", "--host", "base") == [("", "gone is declared in home, and is not there")]
        network.standing.scouts.clear()
        assert "base is out of reach: its cable was cut" in complained(capsys, *over, code=UNREACHABLE)


def test_what_a_scout_tells_of_its_machine_is_checked() -> None:
    class Odd(Direct):
        """A scout that answers its questions otherwise."""

        def __init__(self, **told: Any) -> None:
            super().__init__()
            self._told = told

        def say(self, message: Any) -> None:
            number, do = message["id"], message["do"]
            if do in self._told:
                self._answers.put({"id": number, **self._told[do]})
            self._answers.put({"id": number, "end": True})

    machine = asdict(Machine((Process(7, 3, 1024, "T"),), memory=Space("/dev/shm", "messages", 2, 1, 0, 0)))
    left = {"leftovers": [asdict(Left("shm", 1, 2))]}
    good = {"clock": {"clock": time.time() + 60}, "machine": {"machine": machine}, "leftovers": left}
    wrong: list[dict[str, Any]] = [{"machine": {"machine": machine | {"processes": 7}}}, {"machine": {"machine": None}}]
    wrong += [{"clock": {"clock": "late"}}, {"clock": {}}, {"leftovers": {"leftovers": [{}]}}, {"leftovers": {}}]
    posts = [Post(f"host{number}", partial(Odd, **(good | each))) for number, each in enumerate([{}, *wrong])]
    with contextlib.ExitStack() as end:
        for each in posts:
            end.callback(each.close)
        found, troubles = places(left_there(posts, ["shm"]), ["shm"], Seen())
    assert [(each.host, each.left, each.machine.processes) for each in found] == [
        ("host0", (Left("shm", 1, 2),), (Process(7, 3, 1024, "T"),))
    ]
    assert 50 < found[0].offset < 70
    assert troubles == [f"host{number}: the answer of its scout is not understood" for number in range(1, len(posts))]


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_all_hosts_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with elsewhere.network("base", sums="base", gone="base") as network:
        drawn = tmp_path / "home.svg"
        said(capsys, "graph", "home", "--live", "--host", "base", "-o", str(drawn))
        assert "> base<" in drawn.read_text()
        assert f"process {os.getpid()}" in drawn.read_text()
        assert "missing" in drawn.read_text()
        network.standing.scouts.clear()
        assert rc.main(["graph", "home", "--live", "-o", str(drawn)]) == UNREACHABLE
        assert "could not look: base is out of reach" in capsys.readouterr().err


@pytest.mark.usefixtures("own_runtime_folder", "calculator")
def test_the_monitor_shows_all_hosts_also_of_a_network_that_starts_later() -> None:
    options = argparse.Namespace(network="home", hosts=[], keys=None, middleware=["shm"])
    with contextlib.ExitStack() as end:
        see = sight(options, end)
        assert {each.host for each in see().ends} == {""}
        with elsewhere.network("base") as network:
            assert {each.host for each in see().ends} == {"", "base"}
            network.standing.scouts.clear()
            network.cut()
            wait_until(lambda: see().troubles == ["base is out of reach: its cable was cut"])
