"""A component runs again as its diary says, and what it does otherwise is told."""

from __future__ import annotations

import itertools
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from robocomp_py.cli import rc, rcgen
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import ConfigurationError, RemoteFailure
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing import everything as e
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.diary.events import FLUSH, DiaryReader, DiaryWriter
from robocomp_py.tools.diary.rerun import Result, rerun
from robocomp_py.tools.recording.bag import Options, RecordingError
from robocomp_py.tools.recording.mend import mend
from robocomp_py.transports.base import TransportConfig, TransportFactory
from robocomp_py.transports.inproc import InprocTransport

from ...runtime.components import RELIABLE, EverythingProxy, Station
from ...runtime.running import make, running

_buses = itertools.count()


@pytest.fixture
def find() -> Callable[[str], TransportFactory]:
    bus = f"diary-{next(_buses)}"
    return lambda name: lambda config: InprocTransport(TransportConfig({"bus": bus}, config.owner))


class Thinker(Worker[None]):
    """What it sends depends on all that a component can read."""

    component = Component(
        "thinker",
        (
            Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),
            Port(Verb.SUBSCRIBES, e.EVERYTHING, qos=RELIABLE),
        ),
        period=0.005,
    )
    middleware = "inproc"
    everything_proxy: EverythingProxy
    factor = 3

    def initialize(self) -> None:
        self.count = self.heard = 0

    def compute(self) -> None:
        self.count += 1
        drawn = random.randrange(50) + int(np.random.randint(50)) + int(np.random.default_rng().integers(50))
        quotient, rest = self.everything_proxy.divide(drawn + int(self.random.integers(50)), 7)
        seen = time.time_ns() % 100 + round(time.monotonic()) % 100 + self.now() % 100 + (self.state == "compute")
        self.everything_proxy.poke(self.factor * quotient + rest + self.heard + seen)
        try:
            self.everything_proxy.divide(1, 0)
        except e.Failed as exc:
            self.everything_proxy.poke(exc.code)
        if self.count == 2:
            self.after(0.001, lambda: self.everything_proxy.poke(-1))
        if self.count == 3:
            self.sleep(0.02)

    def Everything_news(self, number: int, text: str) -> None:
        self.heard = (self.heard + number) % 1000


class Changed(Thinker):
    factor = 4


class Silent(Thinker):
    def Everything_news(self, number: int, text: str) -> None: ...


class Shy(Thinker):
    def compute(self) -> None:
        if self.count < 5:
            super().compute()


@pytest.fixture
def diary(find: Any, tmp_path: Path) -> Path:
    """Of some calls of Thinker."""
    path = tmp_path / "thinker.mcap"
    with (
        running(make(Station, find)),
        running(make(Thinker, find, f"component.diary={json.dumps(str(path))}")) as worker,
    ):
        wait_until(lambda: worker.count > 10 and worker.heard)
    return path


def again(worker: type[Worker[Any]], path: Path) -> Result:
    with DiaryReader(path) as reader:
        return rerun(worker, reader)


def test_the_same_code_does_the_same(diary: Path) -> None:
    result = again(Thinker, diary)
    assert (result.differences, result.left_out, result.is_parted) == ([], [], False)
    assert result.outputs >= 40
    assert again(Thinker, diary) == result


def test_the_clocks_and_chance_are_left_as_they_were(diary: Path) -> None:
    before = time.time, time.monotonic
    again(Thinker, diary)
    assert (time.time, time.monotonic) == before
    assert not hasattr(time.time, "__wrapped__")


def test_a_change_is_told_where_it_shows_first(diary: Path) -> None:
    result = again(Changed, diary)
    first = result.differences[0]
    with DiaryReader(diary) as reader:
        events = [reader.start, *iter(reader.take, None)]
    was = [each for each in events if each.get("call") == "everything.poke"]
    assert first.event in [each["event"] for each in was[:4]]
    assert first.what.startswith("everything.poke.number was ")
    assert str(first).startswith(
        f"at {events[first.event]['ns'] / 1e9:.2f} s, event {first.event}: everything.poke.number"
    )
    assert len(result.differences) < result.outputs
    assert not result.is_parted


def test_a_message_that_has_another_effect_is_told(diary: Path) -> None:
    result = again(Silent, diary)
    assert {each.what.partition(" ")[0] for each in result.differences} == {"everything.poke.number"}


def test_code_that_does_something_else_is_told_and_no_further_compared(diary: Path) -> None:
    result = again(Shy, diary)
    (difference,) = result.differences
    assert result.is_parted
    assert difference.what.endswith(" came next, now it is the end of compute")


def test_code_that_fails_where_it_did_not_is_told_with_its_error(diary: Path) -> None:
    class Broken(Shy):
        def compute(self) -> None:
            raise ZeroDivisionError("oh")

    (difference,) = again(Broken, diary).differences
    assert difference.what.endswith(" came next, now it is the end of compute, which fails with ZeroDivisionError: oh")


class Unjust(Station):
    """What it replies depends on chance; one reply is none."""

    share = 1

    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        if dividend == 13:
            raise ValueError("unlucky")
        quotient, remainder = super().Everything_divide(dividend, divisor)
        return quotient + int(self.random.integers(100)), remainder * self.share


class Greedy(Unjust):
    share = 2


class Calm(Unjust):
    def Everything_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        return (0, 0) if dividend == 13 else super().Everything_divide(dividend, divisor)


class Asking(Worker[None]):
    component = Component("asking", (Port(Verb.REQUIRES, e.EVERYTHING, proxy=EverythingProxy),), period=0.001)
    middleware = "inproc"
    everything_proxy: EverythingProxy
    asked = 10

    def compute(self) -> None:
        self.asked += 1
        try:
            self.everything_proxy.divide(self.asked, 4)
        except RemoteFailure:
            self.everything_proxy.poke(self.asked)


def test_replies_and_exceptions_of_handlers_are_compared(find: Any, tmp_path: Path) -> None:
    path = tmp_path / "station.mcap"
    with (
        running(make(Unjust, find, f"component.diary={json.dumps(str(path))}", name="station")),
        running(make(Asking, find, f"component.diary={json.dumps(str(tmp_path / 'asking.mcap'))}")) as worker,
    ):
        wait_until(lambda: worker.asked > 20)
    assert again(Unjust, path).differences == []
    assert again(Greedy, path).differences[0].what == "Everything_divide.remainder was 3, is 6"
    told = "Everything_divide failed with ValueError: unlucky, now it does not fail"
    assert told in [each.what for each in again(Calm, path).differences]
    assert again(Asking, tmp_path / "asking.mcap").differences == []


class Restless(Thinker):
    """Calls asynchronously."""

    def compute(self) -> None:
        self.count += 1
        self.everything_proxy._ask_async(e.work, ("x",), None).result()


def test_what_cannot_be_run_again_is_told(find: Any, tmp_path: Path) -> None:
    path = tmp_path / "thinker.mcap"
    with (
        running(make(Station, find)),
        running(make(Restless, find, f"component.diary={json.dumps(str(path))}")) as worker,
    ):
        wait_until(lambda: worker.count > 2)
    assert again(Restless, path).left_out == ["asynchronous calls"]


def test_two_components_with_diaries_in_one_process_share_random_numbers(find: Any, tmp_path: Path) -> None:
    paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    sets = [f"component.diary={json.dumps(str(path))}" for path in paths]
    with running(make(Station, find, sets[0])), running(make(Asking, find, sets[1])):
        pass
    assert [again(Station, paths[0]).left_out, again(Asking, paths[1]).left_out] == [
        ["`random` and `numpy.random`, which several components of one process share"]
    ] * 2


def test_a_diary_that_cannot_be_written_is_told(find: Any, tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError, match=r"component\.diary: .*nowhere.thinker\.mcap: No such file or directory"
    ):
        make(Thinker, find, f"component.diary={json.dumps(str(tmp_path / 'nowhere' / 'thinker.mcap'))}")


def test_a_second_diary_does_not_replace_the_first(tmp_path: Path) -> None:
    for expected in ("a.mcap", "a_1.mcap", "a_2.mcap"):
        writer = DiaryWriter(tmp_path / "a.mcap")
        writer.close()
        assert writer.path.name == expected


# Files that are wrong.


def written(path: Path, *events: tuple[str, int, dict[str, Any]]) -> Path:
    writer = DiaryWriter(path)
    for kind, turn, more in events:
        writer.write(kind, turn, **more)
    writer.close()
    return path


START = ("start", 0, {"component": "thinker", "instance": "thinker", "configuration": {}, "seed": 1})


@pytest.mark.parametrize(
    ("events", "why"),
    [
        ([], "this is no diary; `rcdeploy --diary COMPONENT` writes one"),
        ([("turn", 1, {"call": "compute"})], "this is no diary"),
        ([START, ("turn", 1, {"call": 5})], "an event of this diary is not understood"),
        (
            [START, ("turn", 1, {"call": "explode"})],
            "event 1 is not understood: this component has no method `explode`",
        ),
        ([START, ("turn", 1, {"call": "Everything_news", "data": b"?"})], "event 1 is not understood: "),
        ([START, ("turn", 1, {"call": "Everything_news", "data": b"\0\1\0\0"})], "event 1 is not understood: "),
        ([START, ("turn", 1, {"call": "after 1"})], "event 1 is not understood: 1"),
        ([START, ("turn", 1, {})], "event 1 is not understood: 'call'"),
        ([("start", 0, {"component": "thinker", "instance": "thinker"})], "event 0 is not understood: 'configuration'"),
    ],
)
def test_a_wrong_diary_is_told(events: list[tuple[str, int, dict[str, Any]]], why: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as told:
        again(Thinker, written(tmp_path / "wrong.mcap", *events))
    assert why in str(told.value)


def test_a_diary_of_another_component_is_told(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", START)
    with pytest.raises(ConfigurationError, match="is the diary of `thinker`, not of `station`"):
        again(Station, path)


@pytest.mark.parametrize("page", [b"half", b"{}\n", b"[" * 9000 + b"\n"])
def test_a_page_of_a_diary_that_is_not_understood_is_told(page: bytes, tmp_path: Path) -> None:
    path = tmp_path / "wrong.mcap"
    with path.open("wb") as file:
        wrong = Writer(file)
        wrong.start()
        wrong.add_message(wrong.register_channel("/diary", "json", 0), 1, page, 1)
        wrong.finish()  # type: ignore[no-untyped-call]  # the library's
    with pytest.raises(RecordingError, match="an event of this diary is not understood"):
        again(Thinker, path)


def test_a_diary_of_another_format_is_told(tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    with path.open("wb") as file:
        old = Writer(file)
        old.start()
        old.add_message(old.register_channel("/diary", "json", 0, {"diary": "1"}), 1, b"{}", 1)
        old.finish()  # type: ignore[no-untyped-call]  # the library's
    with pytest.raises(RecordingError, match=r"another version of robocomp-py has written this diary \(format 1\)"):
        again(Thinker, path)


def test_a_diary_without_an_end_is_mended_and_run_as_far_as_it_goes(diary: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    writer = DiaryWriter(path, itertools.count(0, FLUSH).__next__)
    with DiaryReader(diary) as reader:
        for event in [reader.start, *iter(reader.take, None)][:-3]:
            writer.write(
                event.pop("kind"),
                event.pop("turn"),
                **{key: each for key, each in event.items() if key not in ("event", "ns")},
            )
    with pytest.raises(RecordingError, match="`rc bag mend` makes a readable copy"):
        again(Thinker, path)
    mend(path, tmp_path / "whole", Options())
    assert again(Thinker, tmp_path / "whole").differences == []
    writer.close()


# The command.

CDSL = 'import "Number.idsl"; Component counter {{ Communications {{ publishes NumberPub; }}; language python; {} }};'
IDSL = "module Number { interface NumberPub { void counted(int number); }; };"
CODE = """\
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.number = 0

    def compute(self) -> None:
        print("noise")
        self.number += {step}
        self.numberpub_proxy.counted(self.number)
"""


@pytest.fixture
def counter(tmp_path: Path) -> Path:
    """A component in a folder, and its diary."""
    folder = tmp_path / "counter"
    folder.mkdir()
    (folder / "Number.idsl").write_text(IDSL)
    (folder / "counter.cdsl").write_text(CDSL.format("period 5 ms;"))
    (folder / "specificworker.py").write_text(CODE.format(step=1))
    assert rcgen.main([str(folder / "counter.cdsl")]) == 0
    command = [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(folder), "--set"]
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    running_ = subprocess.Popen([*command, f"component.diary={tmp_path}/counter.mcap"], env=environment)
    try:
        path = tmp_path / "counter.mcap"
        wait_until(lambda: path.exists() and path.stat().st_size > 5000, 3 * SOON)
    finally:
        running_.terminate()
        running_.wait(3 * SOON)
    return folder


def test_the_command_compares_and_shows(counter: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert rc.main(["rerun", str(counter), str(tmp_path / "counter.mcap")]) == 0
    out, err = capfd.readouterr()
    assert out.rstrip().endswith(" outputs differ")
    assert ": 0 of " in out
    assert "noise" not in out + err
    (counter / "specificworker.py").write_text(CODE.format(step=2))
    assert rc.main(["rerun", str(counter), str(tmp_path / "counter.mcap"), "--show"]) == 1
    out, err = capfd.readouterr()
    assert "numberpub.counted.number was 1, is 2\n" in out
    assert "noise" in err
    assert rc.main(["rerun", str(counter), str(tmp_path / "counter.mcap"), "--json"]) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["differences"][0]["what"] == "numberpub.counted.number was 1, is 2"


def git(folder: Path, *words: str) -> None:
    named = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    subprocess.run(["git", "-C", str(folder), *named, *words], check=True, capture_output=True)


def test_the_first_commit_that_differs_is_found(
    counter: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "--quiet", "--initial-branch=main")
    (tmp_path / ".gitignore").write_text("*.mcap\ngeneric/\n")
    for number, code in enumerate(
        [CODE, CODE + "# more\n", CODE + "# still\n", CODE.replace("{step}", "5"), CODE.replace("{step}", "5") + "#\n"]
    ):
        (counter / "specificworker.py").write_text(code.format(step=1))
        git(tmp_path, "add", ".")
        git(tmp_path, "commit", "--quiet", "-m", f"version {number}")
        git(tmp_path, "tag", f"v{number}")
    words = ["rerun", str(counter), str(tmp_path / "counter.mcap"), "--bisect"]
    capfd.readouterr()
    assert rc.main([*words, "v0..v4"]) == 1
    first, second = capfd.readouterr().out.splitlines()
    assert ": version 3 (" in first
    assert re.fullmatch(r"at [\d.]+ s, event \d+: numberpub\.counted\.number was 1, is 5", second)
    assert not list(tmp_path.glob(".git/worktrees/*"))
    assert rc.main([*words, "v0..v2"]) == 2
    assert "v2 does not differ from the diary" in capfd.readouterr().err
    assert rc.main([*words, "v3..v4"]) == 2
    assert "v3 differs from the diary already" in capfd.readouterr().err
    assert rc.main([*words, "v0..v9"]) == 2
    assert capfd.readouterr().err == "rc rerun: `v9` is no commit here\n"
    assert rc.main([*words, "v0"]) == 2
    assert "--bisect v0: write GOOD..BAD, two names of commits" in capfd.readouterr().err


RESCUE = Path(__file__).parents[3] / "components"


def test_wander_in_the_rescue_network_runs_again(tmp_path: Path) -> None:
    shutil.copytree(RESCUE, tmp_path / "components", ignore=shutil.ignore_patterns("__pycache__"))
    deploy = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "components/rescue.ddsl", "--diary", "wander"]
    subprocess.run([*deploy, "--for", "4"], cwd=tmp_path, check=True, capture_output=True)
    again = [sys.executable, "-m", "robocomp_py.cli.rc", "rerun", "components/wander", "wander.mcap", "--json"]
    told = json.loads(subprocess.run(again, cwd=tmp_path, check=True, capture_output=True).stdout)
    assert (told["differences"], told["left_out"]) == ([], [])
    assert told["outputs"] > 5
    steering = tmp_path / "components" / "wander" / "steering.py"
    steering.write_text(steering.read_text().replace("\nTURNING = 2.5", "\nTURNING = 2.4"))
    done = subprocess.run(again, cwd=tmp_path, capture_output=True)
    first = json.loads(done.stdout)["differences"][0]
    assert done.returncode == 1
    assert first["what"].startswith("differentialrobot.setSpeedBase.")
