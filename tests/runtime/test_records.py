"""Log records on one line each, as a launcher reads them."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.runtime.records import LONGEST, MARK, WANTED, RecordFormatter, read, wanted


def written(text: str, number: int = logging.INFO, name: str = "wander", error: BaseException | None = None) -> str:
    about = (type(error), error, error.__traceback__) if error else None
    record = logging.LogRecord(name, number, "/robot/specificworker.py", 41, text, (), about)
    return RecordFormatter(lambda record: "left/wander").format(record)


@given(text=st.text(), number=st.integers(0, 60))
def test_a_short_record_is_read_as_it_was_written(text: str, number: int) -> None:
    line = written(text, number)
    record = read(line)
    assert record is not None
    assert (record.text, record.logger, record.instance) == (text, "wander", "left/wander")
    assert (record.file, record.line) == ("/robot/specificworker.py", 41)
    assert line.isascii()
    assert "\n" not in line


@given(begin=st.text(), fill=st.sampled_from("aä\x00\n\U0001f916"), length=st.integers(4000, 9000), end=st.text())
def test_of_a_long_record_the_middle_is_left_out(begin: str, fill: str, length: int, end: str) -> None:
    line = written(begin[:20] + fill * length + end[:20], name="n" * 5000)
    record = read(line)
    assert record is not None
    assert len(line) <= LONGEST
    assert record.text.startswith(begin[:20])
    assert record.text.endswith(end[:20])
    assert " […] " in record.text


def test_a_traceback_is_one_record() -> None:
    try:
        raise ValueError("no laser")
    except ValueError as exc:
        record = read(written("compute failed", logging.ERROR, error=exc))
    assert record is not None
    assert record.level == "ERROR"
    assert record.text.startswith("compute failed\nTraceback")
    assert record.text.endswith("ValueError: no laser")


@pytest.mark.parametrize(
    ("extra", "trace"), [({}, ""), ({"trace": "a1"}, "a1"), ({"otelTraceID": "b2"}, "b2"), ({"otelTraceID": "0"}, "")]
)
def test_a_record_has_the_trace_that_it_was_logged_with(extra: dict[str, str], trace: str) -> None:
    record = logging.makeLogRecord({"name": "wander", "levelno": logging.INFO, "msg": "near"} | extra)
    line = RecordFormatter(lambda record: "wander").format(record)
    found = read(line)
    assert found is not None
    assert found.trace == trace
    assert ("trace" in line) == bool(trace)


@pytest.mark.parametrize(
    ("number", "level"), [(5, "DEBUG"), (10, "DEBUG"), (25, "INFO"), (30, "WARNING"), (99, "CRITICAL")]
)
def test_a_level_between_two_counts_as_the_lower_one(number: int, level: str) -> None:
    record = read(written("text", number))
    assert record is not None
    assert record.level == level


def test_records_are_written_only_into_the_pipe_of_a_launcher_that_wants_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(WANTED, raising=False)
    assert not wanted()
    monkeypatch.setenv(WANTED, "1")
    file, (out, into), before = os.open(tmp_path / "stderr", os.O_CREAT | os.O_WRONLY), os.pipe(), os.dup(2)
    found = []
    try:
        for each in (file, into):
            os.dup2(each, 2)
            found.append(wanted())
    finally:
        os.dup2(before, 2)
        for each in (file, out, into, before):
            os.close(each)
    assert found == [False, True]


def test_text_before_the_mark_and_objects_of_other_fields_are_no_records() -> None:
    line = written("text")
    told = json.loads(line.removeprefix(MARK))
    for wrong in (line.removeprefix(MARK), " " + line, MARK + json.dumps(told | {"more": 1}), line + " " * LONGEST):
        assert read(wrong) is None


def test_a_component_without_a_launcher_does_not_import_it() -> None:
    code = "import sys, robocomp_py.runtime.run; print('robocomp_py.runtime.records' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "False\n"
