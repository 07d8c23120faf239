"""The output of components, in files that are bounded and block no process."""

from __future__ import annotations

import json
import resource
import signal
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import pytest

from robocomp_py.deploy.logs import KEPT, Form, Logs, logged_names, past_lines, told
from robocomp_py.deploy.ring import Line, printed
from robocomp_py.errors import DeploymentError
from robocomp_py.runtime.records import MARK, Record


@pytest.fixture
def logs(tmp_path: Path) -> Iterator[Logs]:
    made = Logs(tmp_path / "logs", altogether=0)
    yield made
    made.close()


def test_each_has_a_file_with_the_time_of_each_line(logs: Logs) -> None:
    logs.write(Line(0.0, "laser", "ready"))
    logs.write(Line(1.0, "left/arm", "WARNING: too close"))
    assert (logs.folder / "laser.log").read_text() == "1970-01-01T00:00:00.000000+00:00 ready\n"
    assert (logs.folder / "left.arm.log").read_text() == "1970-01-01T00:00:01.000000+00:00 WARNING: too close\n"


def test_lines_of_the_same_millisecond_are_recalled_in_the_order_in_which_they_came(tmp_path: Path) -> None:
    logs = Logs(tmp_path)
    said = [
        Line(1.5001, "rcdeploy", "stopping"),
        Line(1.5002, "laser", "bye"),
        Line(1.5003, "rcdeploy", "laser has ended"),
    ]
    for line in said:
        logs.write(line)
    logs.close()
    assert past_lines(tmp_path, [], 3) == said


def test_lines_of_earlier_runs_are_left_out_where_only_the_newest_is_asked_for(tmp_path: Path) -> None:
    logs = Logs(tmp_path)
    for at, text in ((1.0, "of the first run"), (5.0, "of the second"), (6.0, "and more")):
        logs.write(Line(at, "left/arm", text))
    logs.close()
    with (tmp_path / "left.arm.log").open("a") as file:
        file.write("from elsewhere, without a time\n")
    newest = [Line(5.0, "left.arm", "of the second"), Line(6.0, "left.arm", "and more")]
    assert past_lines(tmp_path, ["left"], 10, since=5.0) == newest
    assert past_lines(tmp_path, [], 10)[0] == Line(0.0, "left.arm", "from elsewhere, without a time")
    assert (logged_names(tmp_path), logged_names(tmp_path, ["lef"])) == (["left.arm"], [])


TRACEBACK = Record(1.5, "ERROR", "left", "left", "compute", "w.py", 7, "failed\nTraceback:\n  ValueError: no")


@pytest.mark.parametrize("form", Form)
def test_a_record_of_several_lines_is_one_line_again_when_it_is_read(tmp_path: Path, form: Form) -> None:
    logs = Logs(tmp_path, form=form)
    logs.write(Line(1.0, "both", "printed"))
    logs.write(printed(2.0, "both", MARK + json.dumps(asdict(TRACEBACK))))
    logs.write(Line(3.0, "both", "\tprinted, too"))
    logs.close()
    _, record, last = past_lines(tmp_path, [], 10)
    assert (record.at, record.level, last.text) == (2.0, "ERROR", "\tprinted, too")
    assert record.text == "ERROR: left: failed\nTraceback:\n  ValueError: no"
    assert record.record == (TRACEBACK if form is Form.JSON else None)
    assert past_lines(tmp_path, [], 1, 0.0, lambda line: line.level == "ERROR") == [record]


def test_json_that_is_no_record_is_a_printed_line() -> None:
    whole = asdict(TRACEBACK)
    for wrong in ({**whole, "level": "LOUD"}, {**whole, "time": 1e300}, {**whole, "line": True}, {"text": "a"}, [], 1):
        line = MARK + json.dumps(wrong)
        assert printed(1.0, "laser", line) == Line(1.0, "laser", line)
    for broken in ("", "{", "[" * 3000, '{"time": NaN}'):
        assert printed(1.0, "laser", MARK + broken).record is None


def test_what_machines_are_told_of_a_record(tmp_path: Path) -> None:
    line = printed(2.0, "both", MARK + json.dumps(asdict(TRACEBACK)))
    when = "1970-01-01T00:00:0{}+00:00"
    assert told(line) == {
        **{"time": when.format("2.000000"), "logged": when.format("1.500000"), "name": "both", "instance": "left"},
        **{"level": "error", "logger": "left", "thread": "compute", "file": "w.py", "line": 7},
        "text": TRACEBACK.text,
    }


def test_a_name_is_no_path(logs: Logs) -> None:
    logs.write(Line(1.0, "../../etc/passwd", "root"))
    assert [path.name for path in logs.folder.iterdir()] == ["etc.passwd.log"]


def test_for_machines_each_line_is_json(tmp_path: Path) -> None:
    logs = Logs(tmp_path, form=Form.JSON)
    logs.write(Line(0.5, "left/arm", "WARNING: zu nah: 3 µm"))
    logs.write(Line(0.5, "left/arm", "and more"))
    logs.close()
    first, second = map(json.loads, (tmp_path / "left.arm.log").read_text().splitlines())
    when = "1970-01-01T00:00:00.500000+00:00"
    assert first == {"time": when, "name": "left/arm", "level": "warning", "text": "zu nah: 3 µm"}
    assert second == {"time": when, "name": "left/arm", "level": "", "text": "and more"}


def test_a_long_file_is_followed_by_a_new_one_and_the_oldest_is_gone(logs: Logs) -> None:
    for number in range(330):
        logs.write(Line(number, "noisy", f"{number} " + "x" * 1000))
    files = sorted(path.name for path in logs.folder.iterdir())
    assert files == ["noisy.log", *(f"noisy.log.{number + 1}" for number in range(KEPT))]
    assert all(path.stat().st_size < 70_000 for path in logs.folder.iterdir())


def test_the_newest_lines_come_from_several_files_in_order(logs: Logs) -> None:
    for number in range(70):
        logs.write(Line(number, "noisy", f"{number} " + "x" * 1000))
        logs.write(Line(number + 0.5, "quiet", str(number)))
    assert (logs.folder / "noisy.log.1").exists()
    newest = [line.text.split()[0] for line in past_lines(logs.folder, ["noisy"], 20)]
    assert newest == [str(number) for number in range(50, 70)]
    assert [line.text.split()[0] for line in past_lines(logs.folder, [], 4)] == ["68", "68", "69", "69"]
    assert past_lines(logs.folder, ["nobody"], 4) == []


def test_a_line_is_one_whatever_is_in_it(logs: Logs) -> None:
    lines = ["50 %\r100 % done", "a page\x0canother one", "\u2028", "the last one"]
    for line in lines:
        logs.write(Line(1.0, "laser", line))
    kept = ["50 %100 % done", "a pageanother one", "\\u2028", "the last one"]
    assert [line.text for line in past_lines(logs.folder, ["laser"], 10)] == kept


def test_lines_lost_on_a_full_disk_are_reported_once_and_counted(logs: Logs, caplog: pytest.LogCaptureFixture) -> None:
    logs.write(Line(1.0, "laser", "one"))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    deaf = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50, before[1]))  # room for a part of the next line
        logs.write(Line(1.0, "laser", "two"))
        logs.write(Line(1.0, "laser", "three"))
        assert logs.lost == {"laser": 2}
        assert caplog.messages == [
            f"lines are missing in the logs in {logs.folder} from here on: No space left on device"
        ]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, deaf)
    logs.write(Line(1.0, "laser", "four"))
    told = [line.split(" ", 1)[1] for line in (logs.folder / "laser.log").read_text().splitlines()]
    assert told == ["one", "WARNING: 2 lines were lost here: they could not be written", "four"]
    assert not logs.lost


def test_a_folder_that_cannot_be_made_is_reported_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DeploymentError, match=r"logs in .*file/logs: Not a directory"):
        Logs(tmp_path / "file" / "logs")
