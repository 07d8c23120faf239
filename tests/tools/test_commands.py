"""The commands that look at, measure and use what runs, against components over every middleware that can tell."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import Durability
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.access import Access
from robocomp_py.tools.census import take_census
from robocomp_py.tools.publishing import publish
from robocomp_py.tools.tap import Message, Presence, tap, tapped
from robocomp_py.transports.base import find_transport
from robocomp_py.transports.directory import Directory, state_of
from robocomp_py.transports.members import Entry
from robocomp_py.transports.runtime_folder import runtime_dir

from ..runtime.components import RELIABLE, Calculator, Station
from ..runtime.running import make, running
from .commands import TELLERS, complained, heard, said
from .talkers import Listener, Talker


@pytest.fixture(params=TELLERS)
def talker(request: pytest.FixtureRequest) -> Iterator[Any]:
    over = f"middleware={request.param}"
    with running(make(Talker, find_transport, over, name="talker")) as worker:
        wait_until(lambda: "talker/Everything/news" in take_census([request.param]).channels)
        worker.middleware_used = request.param
        yield worker


class Rude(Talker):
    texts = ("\x1b[2J\u202egone\nnext",)


def test_control_characters_of_others_reach_files_and_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["echo", "news", "-n", "1", "--csv", "--field", "text", "--middleware", "shm"]
    with running(make(Rude, find_transport, "middleware=shm", name="talker")):
        raw = said(capsys, *words)
        seen, terminal = os.openpty()
        with os.fdopen(terminal, "w") as screen, contextlib.redirect_stdout(screen):
            assert rc.main(words) == 0
    with os.fdopen(seen, "rb") as screen_:
        shown = screen_.read1(10_000).decode()
    assert "\x1b[2J\u202egone\nnext" in raw
    assert "\ufffd[2J\ufffdgone next" in shown
    assert "\x1b" not in shown


def test_components_are_listed(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    found = [json.loads(line) for line in said(capsys, "list", "--json").splitlines()]
    (one,) = [each for each in found if each["owner"] == "talker"]
    assert one == {
        "owner": "talker",
        "pid": os.getpid(),
        "host": "",
        "middlewares": [talker.middleware_used],
        "offers": ["Everything"],
        "uses": [],
    }
    assert "talker" in said(capsys, "list")


@pytest.mark.parametrize("middleware", TELLERS)
def test_components_are_listed_with_their_namespaces_and_without_tools(
    middleware: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A client serves nothing of its own but what every component does."""
    over = (f"middleware={middleware}", "namespace=robot1/left")
    topic = "robot1/left/talker/Everything/news"
    with running(make(Talker, find_transport, *over, name="talker")), Access() as access:
        wait_until(lambda: topic in take_census([middleware]).channels)
        access.hear(take_census([middleware]).channels[topic], lambda payload: None, 10)
        wait_until(lambda: take_census([middleware]).channels[topic].users)

        def owners(*options: str) -> list[str]:
            lines = said(capsys, "list", "--json", "--middleware", middleware, *options).splitlines()
            return [json.loads(line)["owner"] for line in lines]

        assert owners() == ["robot1/left/talker"]
        assert owners("--all") == ["rc", "robot1/left/talker"]


def test_channels_are_listed(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [json.loads(line) for line in said(capsys, "list", "--topics", "--json").splitlines()]
    assert lines == [
        {
            "channel": "talker/Everything/news",
            "pattern": "publish",
            "middlewares": [talker.middleware_used],
            "providers": ["talker"],
            "users": [],
        }
    ]
    assert re.search(r"talker/Everything/divide +query +", said(capsys, "list", "--channels"))
    assert "talker/CommonBehavior/getState" in said(capsys, "list", "--queries", "--all")


def test_a_topic_is_heard(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [json.loads(line) for line in said(capsys, "echo", "Everything", "-n", "3", "--json").splitlines()]
    assert [each["channel"] for each in lines] == ["talker/Everything/news"] * 3
    assert all(each["message"]["text"] == "hello" for each in lines)
    numbers = [each["message"]["number"] for each in lines]
    assert numbers == list(range(numbers[0], numbers[0] + 3))
    assert said(capsys, "echo", "news", "-n", "1", "--field", "text").rstrip().endswith('"hello"')


def test_only_messages_that_fit_are_printed(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    talker.texts = ["even", "odd"]
    listed = said(capsys, "echo", "news", "-n", "3", "--where", "text=odd", "--where", "number>2", "--json")
    found = [json.loads(line)["message"] for line in listed.splitlines()]
    assert all(each["text"] == "odd" and each["number"] > 2 and each["number"] % 2 for each in found)
    assert len(found) == 3


def test_it_is_told_if_no_message_fits(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    seconds = 0.5
    while "messages were heard, and none fits --where" not in (
        told := complained(capsys, "echo", "news", "--for", f"{seconds:g}", "--where", "number<0")
    ):
        assert seconds < SOON * 3, told
        seconds *= 4  # a busy machine hears nothing in so short a time


def test_every_tenth_message_is_printed(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "echo", "news", "-n", "3", "--every", "10", "--json").splitlines()
    first, *others = [json.loads(line)["message"]["number"] for line in lines]
    assert others == [first + 10, first + 20]


def test_messages_are_a_table(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    talker.texts = ['say "hello", world']
    listed = said(capsys, "echo", "news", "-n", "3", "--csv", "--stamps", "--where", "text!=hello")
    head, *rows = csv.reader(listed.splitlines())
    assert head == ["time", "sent", "number", "number", "text"]
    assert [row[4] for row in rows] == talker.texts * 3
    times, numbers = [[float(row[column]) for row in rows] for column in (0, 3)]
    assert numbers == [numbers[0] + each for each in range(3)]
    assert times == sorted(times)
    assert said(capsys, "echo", "news", "-n", "1", "--csv", "--field", "text").startswith("time,text\n")


def test_stamps_of_messages_are_printed(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "echo", "news", "-n", "3", "--stamps", "--json").splitlines()
    found = [json.loads(line) for line in lines]
    first = found[0]["number"]
    assert [each["number"] for each in found] == [first, first + 1, first + 2]
    assert all(each["sent"] <= each["time"] for each in found)
    assert re.search(r"\(number \d+ sent [\d:.]+, [\d.]+ ms\) \{", said(capsys, "echo", "news", "-n", "1", "--stamps"))


def test_several_fields_are_printed_by_their_names(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    line = said(capsys, "echo", "news", "-n", "1", "--field", "*", "--json")
    assert json.loads(line)["message"].keys() == {"number", "text"}


@pytest.mark.parametrize("middleware", TELLERS)
def test_a_publisher_that_ends_and_comes_back_is_told(middleware: str) -> None:
    topic = "talker/Everything/news"
    over = f"middleware={middleware}"
    with contextlib.ExitStack() as end:
        with running(make(Talker, find_transport, over, name="talker")):
            wait_until(lambda: topic in take_census([middleware]).channels)
            heard = tapped([take_census([middleware]).channels[topic]], first=SOON, whole=SOON)
            end.callback(heard.close)
            assert isinstance(next(heard), Message)
        assert next(each for each in heard if isinstance(each, Presence)) == Presence(topic, False)
        with running(make(Station, find_transport, over, name="talker")):
            assert next(heard) == Presence(topic, True)


def test_the_rate_of_a_topic_is_measured(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    *_, last = (json.loads(line) for line in heard(capsys, "hz", "news", "--json", seconds=1.2).splitlines())
    assert last["channel"] == "talker/Everything/news"
    assert 0 < last["hz"] < 1000
    assert last["messages"] > 1
    assert last["shortest_s"] <= 1 / last["hz"] <= last["longest_s"]
    assert last["middleware"] == talker.middleware_used
    assert last["gaps"] is not None


def test_the_sizes_of_messages_are_measured(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """Every other text is 400 octets longer, and all is encoded alike."""
    talker.texts = ["x" * 300, "x" * 700]
    talker.number = 1000  # as many octets as any later number
    *_, last = (json.loads(line) for line in heard(capsys, "bw", "news", "--json", seconds=1.2).splitlines())
    assert last["channel"] == "talker/Everything/news"
    assert last["messages"] >= 2
    assert last["smallest"] > 300
    assert last["largest"] - last["smallest"] == 400
    assert last["smallest"] < last["mean"] < last["largest"]
    assert last["octets_per_s"] > 0
    shown = heard(capsys, "bw", "news", seconds=0.5)
    assert re.match(
        rf"talker/Everything/news over {talker.middleware_used}: [\d.]+ kB/s, \d+ B to \d+ B a message, ", shown
    )


def test_the_age_of_messages_is_measured(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    *_, last = (json.loads(line) for line in heard(capsys, "delay", "news", "--json", seconds=1.2).splitlines())
    assert last["channel"] == "talker/Everything/news"
    assert 0 < last["median_s"] <= last["p99_s"]
    assert last["one_clock"]
    shown = heard(capsys, "delay", "news", seconds=0.5)
    over = f"talker/Everything/news over {talker.middleware_used}"
    assert re.match(rf"{over}: [\d.]+ ms, 99 % within [\d.]+, \d+ messages \(one clock\)\n", shown)


def test_a_query_is_called(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert json.loads(said(capsys, "call", "divide", "dividend=17", "divisor=5")) == {"ret": 3, "remainder": 2}
    assert json.loads(said(capsys, "call", "talker/Everything/divide", '{"dividend": 9, "divisor": 3}'))
    thrown = complained(capsys, "call", "divide", "dividend=1", "divisor=0")
    assert thrown == 'rc call: Conformance.Failed: {"what": "division by zero", "code": 7}\n'


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
@pytest.mark.parametrize(
    ("word", "text"), [("12", "12"), ("true", "true"), ('"12"', "12"), ("null", "null"), ("größe", "größe")]
)
def test_a_text_is_a_text_whatever_it_looks_like(
    talker: Any, word: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said(capsys, "call", "work", f"task={word}") == f'"{text}"\n'


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
def test_a_query_is_called_again_and_again(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    divide = ("call", "divide", "dividend=9", "divisor=4", "--repeat", "3")
    assert said(capsys, *divide, "--rate", "1000").splitlines() == ['{"ret": 2, "remainder": 1}'] * 3
    thrown = said(capsys, "call", "divide", "dividend=1", "divisor=0", "--repeat", "2", "--json", code=1)
    assert [json.loads(line)["exception"] for line in thrown.splitlines()] == ["Conformance.Failed"] * 2
    said(capsys, "call", "poke", "number=5", "--repeat", "4")
    wait_until(lambda: talker.entries.count("poked 5") == 4)


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
def test_a_contract_is_told_to_machines(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    told = json.loads(said(capsys, "info", "news", "--json"))
    (end,) = told["ends"]
    assert (end["role"], end["qos"]["reliability"], end["qos"]["depth"]) == ("publishes", "reliable", 10)
    (served,) = json.loads(said(capsys, "info", "divide", "--json"))["ends"]
    assert served["qos"] is None


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
def test_a_measurement_ends_with_one_line(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys, "hz", "news", "--for", "1.1", "--json").splitlines()
    numbers = [json.loads(line)["messages"] for line in lines]
    assert len(set(numbers)) == len(numbers)


def test_a_contract_is_shown_with_both_sides(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    shown = said(capsys, "info", "talker/Everything/divide")
    assert "int64 divide(int64 dividend, int64 divisor, out int64 remainder) throws Failed;" in shown
    assert "exception Failed { string what; int32 code; };" in shown
    assert f"served by talker (process {os.getpid()}) over {talker.middleware_used}" in shown
    shown = said(capsys, "info", "news")
    assert f"published by talker (process {os.getpid()}) over {talker.middleware_used}: reliable, volatile" in shown


def test_the_depth_of_a_subscriber_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    over = ("middleware=shm", "ports.Everything.qos.depth=7")
    with (
        running(make(Talker, find_transport, "middleware=shm", name="talker")),
        running(make(Listener, find_transport, *over, name="listener")),
    ):
        shown = said(capsys, "info", "news", "--middleware", "shm")
    assert f"subscribed by listener (process {os.getpid()}) over shm: best_effort, volatile, depth 7" in shown


@pytest.mark.parametrize("middleware", [name for name in TELLERS if name != "dds"])
def test_a_subscriber_hears_what_a_tool_publishes(middleware: str, capsys: pytest.CaptureFixture[str]) -> None:
    over = f"middleware={middleware}"
    with running(make(Listener, find_transport, over, name="listener")) as worker:
        wait_until(lambda: any(each.uses for each in take_census([middleware]).components()))
        said(capsys, "pub", "phantom/Everything/news", '{"number": 7, "text": "boo"}')
        wait_until(lambda: "7 boo" in worker.entries)
        again = ("pub", "phantom/Everything/news", "number=8", "text=again", "-n", "2", "--rate", "100", "--json")
        assert json.loads(said(capsys, *again)) == {"channel": "phantom/Everything/news", "messages": 2}
        wait_until(lambda: worker.entries.count("8 again") == 2)


class LateListener(Listener):
    component = Component(
        "late", (Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=replace(RELIABLE, durability=Durability.TRANSIENT_LOCAL)),)
    )


def test_a_late_subscriber_hears_what_a_tool_has_latched() -> None:
    over = threading.Event()

    def publishing() -> None:
        with Access() as access:
            topic = take_census(["zeromq"]).topic("talker/Everything/news")
            publish(access, topic, (-7, "map"), SOON, latched=True, over=over)

    keeping = threading.Thread(target=publishing)
    with running(make(Talker, find_transport, "middleware=zeromq", name="talker")):
        wait_until(lambda: "talker/Everything/news" in take_census(["zeromq"]).channels)
        keeping.start()
        try:
            wait_until(lambda: len(take_census(["zeromq"]).topic("talker/Everything/news").providers) == 2)
            with running(make(LateListener, find_transport, "middleware=zeromq", name="late")) as worker:
                wait_until(lambda: "-7 map" in worker.entries)
        finally:
            over.set()
            keeping.join(SOON)
    assert not keeping.is_alive()


@pytest.mark.tool
def test_a_query_is_called_over_ice(capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Calculator, find_transport, "middleware=ice", name="reckoner")):
        assert json.loads(said(capsys, "call", "reckoner/Everything/divide", "dividend=17", "divisor=5"))["ret"] == 3


def test_a_command_is_sent(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    said(capsys, "call", "poke", "number=4")
    wait_until(lambda: "poked 4" in talker.entries)


def test_a_call_without_arguments_shows_what_it_takes(talker: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert json.loads(said(capsys, "call", "divide", code=2)) == {"dividend": 0, "divisor": 0}


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("call", "divide", "dividend=1"), 1, "divide: lacks `divisor`; it takes {dividend int64, divisor int64}"),
        (
            ("call", "divide", "dividend"),
            2,
            "is neither FIELD=VALUE, nor a JSON object, nor @FILE; write dividend=VALUE",
        ),
        (("call", "divide", "dividend", "7"), 2, "nor a JSON object, nor @FILE; write dividend=7"),
        (("call", "divide", "7", "2"), 2, "nor a JSON object, nor @FILE; write dividend=7 divisor=2"),
        (("call", "divide", "dividend=1", "dividend=2", "divisor=1"), 2, "`dividend` is given twice"),
        (("call", "divide", "{"), 2, "the argument is no JSON"),
        (("call", "divide", "[" * 9000), 2, "is neither FIELD=VALUE, nor a JSON object, nor @FILE"),
        (("call", "divide", '{"a":' * 9000), 2, "the argument is nested too deep"),
        (("call", "divide", "dividend=" + "[" * 9000, "divisor=1"), 1, "it takes int64"),
        (("call", "divide", "@nowhere.json"), 2, "nowhere.json: No such file or directory"),
        (("call", "divide", "dividend=2", "divisor=3", "dividend.y=1"), 2, "has a value of its own"),
        (("call", "Everything", "--timeout", "0.1"), 1, "`Everything` may be talker/Everything/divide, talker/"),
        (("call", "news", "--timeout", "0.1"), 1, "is a topic; `rc echo news` prints what is published"),
        (("echo", "divide", "--timeout", "0.1"), 1, "`divide` is no topic: talker/Everything/divide is a query"),
        (("echo", "nws", "--timeout", "0.1"), 1, "`nws` is not there; did you mean `news`?"),
        (("call", "divide", "dividend=1e999", "divisor=1"), 1, "the number inf is given; it takes int64"),
        (("echo", "news", "--field", "txt"), 2, "talker/Everything/news: unknown field `txt`; did you mean `text`?"),
        (("echo", "news", "--field", "text["), 2, "`text[` is no path; write it as a.b, a[0].b, a[*].b for all items"),
        (("echo", "news", "--field", "text[0]"), 2, "`text` is string, and has no item 0"),
        (("echo", "news", "--where", "number>x"), 2, "`number` is int32; compare it with a number, and not `x`"),
        (("echo", "news", "--csv", "--json"), 2, "--csv and --json exclude each other"),
        (("pub", "divide"), 1, "no topic: talker/Everything/divide is a query; `rc call divide` calls it"),
        (("record", "divide", "--timeout", "0.1"), 1, "talker/Everything/divide is a query; `rc echo --calls divide`"),
        (("echo", "nwes", "--timeout", "0.1"), 1, "did you mean `news`?"),
        (("pub", "news", "number=1", "text=x", "--timeout", "0.1"), 1, "nothing subscribes to talker/Everything/news"),
        (("pub", "news", "number=1"), 1, "rc pub: news: lacks `text`; it takes {number int32, text string}"),
        (("info", "nws", "--timeout", "0.1"), 1, "`nws` is not there; did you mean `news`?"),
        (("hz", "elephant", "--timeout", "0.1"), 1, "`elephant` is not there; `rc list --channels` shows all"),
        (("list", "--middleware", "inproc"), 2, "inproc cannot tell what uses it"),
    ],
)
def test_what_is_wrong_is_told(
    talker: Any, arguments: tuple[str, ...], code: int, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in complained(capsys, *arguments, code=code)


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
@pytest.mark.parametrize(("content", "why"), [(b"\xe9t\xe9", "is no JSON: "), (b"[" * 9000, "is nested too deep")])
def test_a_file_that_is_no_request_is_named(
    talker: Any, content: bytes, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "request.json"
    path.write_bytes(content)
    assert f"{path} {why}" in complained(capsys, "call", "divide", f"@{path}", code=2)


@pytest.mark.parametrize(
    "arguments",
    [("echo", "a", "-n", "0"), ("hz", "a", "--for", "-1"), ("bw", "a", "--window", "0"), ("echo",), ("call",)],
)
def test_usage_is_told(arguments: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as ended:
        rc.main(list(arguments))
    assert ended.value.code == 2


def test_nothing_runs(own_runtime_folder: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert complained(capsys, "list") == "rc list: there are no components here\n"
    assert complained(capsys, "list", "--topics", "--queries") == "rc list: there are no topics or queries here\n"


def test_a_wait_for_a_name_is_shown_on_a_terminal(
    own_runtime_folder: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for command in (["hz", "elephant"], ["record", "elephant", "-o", str(tmp_path / "run")]):
        seconds, parts = 1.5, list[str]()
        while len(parts) < 3:  # a busy machine may look but once in a short time
            assert seconds < SOON * 6
            terminal = Terminal()
            with monkeypatch.context() as here:
                here.setattr("sys.stderr", terminal)
                assert rc.main([*command, "--timeout", f"{seconds:g}"]) == 1
            parts, waited, seconds = terminal.getvalue().split("\r\x1b[K"), seconds, seconds * 4
        assert parts[1].startswith(f"rc {command[0]}: waiting up to {waited:g} s: ")
        assert parts[-1].startswith(f"rc {command[0]}: ")
        assert "elephant" in parts[-1]


def test_a_topic_that_is_silent_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with running(make(Station, find_transport, "middleware=shm", name="silent")):
        assert "nothing was heard in 0.2 s" in complained(capsys, "echo", "silent/Everything", "--timeout", "0.2")


def test_a_tool_waits_for_what_is_not_there_yet(capsys: pytest.CaptureFixture[str]) -> None:
    """It is started first, as in another terminal."""
    codes: list[int] = []
    hearing = threading.Thread(target=lambda: codes.append(rc.main(["echo", "late/Everything", "-n", "1"])))
    hearing.start()
    with running(make(Talker, find_transport, "middleware=shm", name="late")):
        hearing.join(SOON)
    assert codes == [0]


def test_no_publisher_waits_for_a_tool(talker: Any) -> None:
    """A reliable publisher goes on while a tool takes nothing."""
    may_end = []
    channel = take_census([talker.middleware_used]).channels["talker/Everything/news"]
    with Access() as access:
        access.hear(channel, lambda payload: wait_until(lambda: may_end), 10)
        reached = talker.number
        wait_until(lambda: talker.number > reached + 30)
        may_end.append(True)


class Bursting(Talker):
    """Publishes many messages at once when it is told to."""

    burst = 0

    def compute(self) -> None:
        number, self.burst = self.burst, 0
        for _ in range(number + 1):
            super().compute()


def test_what_was_published_while_the_user_had_stopped_a_tool_is_no_gap() -> None:
    many = 2000  # a tool that a busy machine leaves waiting misses fewer
    with running(make(Bursting, find_transport, "middleware=shm", name="steady")) as worker, Access() as access:
        wait_until(lambda: "steady/Everything/news" in take_census(["shm"]).channels)
        channel = take_census(["shm"]).channels["steady/Everything/news"]
        access.hear(channel, lambda payload: None, 10)  # without a subscriber, messages would not be counted
        command = [sys.executable, "-m", "robocomp_py.cli.rc", "hz", "steady/Everything", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as tool:
            assert tool.stdout
            try:
                before = json.loads(tool.stdout.readline())
                tool.send_signal(signal.SIGTSTP)
                wait_until(lambda: state_of(tool.pid) == "T")
                reached = worker.number
                worker.burst = many
                wait_until(lambda: worker.number > reached + many)
                tool.send_signal(signal.SIGCONT)
                after = next(each for each in map(json.loads, tool.stdout) if each["messages"] > before["messages"])
                assert after["missing"] < before["missing"] + many
            finally:
                tool.kill()


def test_a_contract_that_is_not_understood_is_told(
    own_runtime_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = own_runtime_folder / "shm"
    folder.mkdir()
    member = Directory(folder).join("riddler")
    try:
        for role in ("publishes", "serves"):
            member.add(Entry(role, f"riddler/Riddle/{role}", 7, "who am I"))
        why = "is not understood: operation is missing"
        assert why in complained(capsys, "echo", "publishes", "--for", "0.1")
        assert why in complained(capsys, "call", "serves")
        assert why in said(capsys, "info", "serves")
        assert "riddler" in said(capsys, "list")
    finally:
        member.close()


@pytest.mark.parametrize("talker", ["shm"], indirect=True)
@pytest.mark.parametrize("command", ["echo", "hz", "delay"])
def test_a_topic_whose_contract_is_not_understood_hides_no_other(
    talker: Any, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    member = Directory(runtime_dir("shm")).join("talker")
    try:
        member.add(Entry("publishes", "talker/Everything/riddle", 7, "who am I"))
        why = "the contract of talker/Everything/riddle is not understood: operation is missing, so it is left out"
        seconds = 1.0
        while rc.main([command, "talker/Everything", "--for", f"{seconds:g}"]):  # a busy machine may hear nothing
            assert seconds < SOON * 3, capsys.readouterr()
            seconds *= 4
        done = capsys.readouterr()
        assert f"rc {command}: {why}" in done.err
        assert done.out
    finally:
        member.close()


def test_a_tool_that_ends_does_not_wait_for_its_own_handler_of_ctrl_z() -> None:
    """The signal comes while the main thread tells the others that it ends, and may hold a lock for that."""
    calls: list[str] = []

    def interrupt(frame: FrameType, event: str, argument: object) -> None:
        if frame.f_code.co_filename == threading.__file__ or isinstance(
            getattr(argument, "__self__", None), queue.SimpleQueue
        ):
            calls.append(event)
            signal.raise_signal(signal.SIGTSTP)

    with tap([]):
        sys.setprofile(interrupt)
    sys.setprofile(None)
    assert calls


class Loud(Talker):
    def compute(self) -> None:
        self.number += 1
        self.everything_proxy.news(self.number, "x" * 20_000)


def test_a_tool_whose_output_nothing_reads_can_be_stopped() -> None:
    """As by Ctrl-Z, while it writes to a full pipe."""
    with running(make(Loud, find_transport, "middleware=shm", name="loud")) as worker:
        command = [sys.executable, "-m", "robocomp_py.cli.rc", "echo", "loud/Everything", "--full"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as tool:
            assert tool.stdout
            try:
                tool.stdout.read(1)
                reached = worker.number
                wait_until(lambda: worker.number > reached + 20)
                tool.send_signal(signal.SIGTSTP)
                wait_until(lambda: state_of(tool.pid) == "T")
                tool.send_signal(signal.SIGCONT)
                wait_until(lambda: state_of(tool.pid) != "T")
            finally:
                tool.kill()
