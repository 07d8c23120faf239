"""What a controller and an agent tell each other."""

from __future__ import annotations

import tracemalloc
from itertools import chain
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.agents import Life, Usage
from robocomp_py.deploy.hosts import lines
from robocomp_py.deploy.hosts.lines import Lines, packed, process_of, told, usage_of, usage_told
from robocomp_py.deploy.process import Member, Process
from robocomp_py.errors import DeploymentError

LASER = Process(
    "left/laser",
    "Laser",
    ("python3", "-m", "laser", "it's"),
    Path("/work"),
    {"A": "ö"},
    notifies=False,
    members=(Member("left/laser", "Laser"),),
    host="robot",
    grace=2.5,
    system=("left",),
)


def test_a_process_arrives_as_it_was_but_for_where_it_runs():
    there = process_of(told(LASER, ("python3.12", "x"), "/home/robot"))
    assert there.command == ("python3.12", "x")
    assert there.cwd == Path("/home/robot")
    assert (there.name, there.env, there.members) == (LASER.name, LASER.env, LASER.members)
    assert (there.notifies, there.grace, there.system) == (LASER.notifies, LASER.grace, LASER.system)


@pytest.mark.parametrize("wrong", [{}, {"name": "a"}, {**told(LASER, (), ""), "members": [1]}])
def test_a_process_that_is_not_understood_is_refused(wrong: dict[str, object]):
    with pytest.raises(DeploymentError, match="malformed"):
        process_of(wrong)


def test_usage_arrives_as_it_was():
    usage = {"laser": Usage(12, 0.5, 1000, 2.0, 0.25, 77.5, {"laser": Life("compute", 1, 2, 3, "0.1.0")})}
    assert usage_of(usage_told(usage)) == usage


@given(st.lists(st.text()), st.integers(1, 50))
def test_lines_are_found_however_they_come(texts: list[str], size: int):
    data = b"".join(packed({"tell": "output", "line": text}) for text in texts)
    found = Lines(lines.LONGEST)
    parts = [data[start : start + size] for start in range(0, len(data), size)]
    assert [message["line"] for part in parts for message in found.feed(part)] == texts


@pytest.mark.parametrize("line", [b"hello\n", b"[1]\n", b"\xff\n", b"[" * 100_000 + b"\n"])
def test_lines_of_another_protocol_are_not_understood(line: bytes):
    with pytest.raises(DeploymentError, match="malformed"):
        list(Lines(lines.LONGEST).feed(line))


@pytest.mark.parametrize("parts", [[bytes(101)], [bytes(60), bytes(41)], [bytes(101) + b"\n"], [bytes(99), b"xy\n"]])
def test_a_line_that_is_too_long_is_not_kept(parts: list[bytes]):
    found = Lines(100)
    with pytest.raises(DeploymentError, match="more than 100 octets"):
        list(chain.from_iterable(map(found.feed, parts)))


def test_a_line_of_a_host_takes_little_memory():
    text = b'{"tell": "hello", "version": 4, "kept": [' + b"[]," * (lines.LONGEST_TOLD // 3 - 20) + b"[]]}\n"
    tracemalloc.start()
    try:
        (message,) = Lines(lines.LONGEST_TOLD).feed(text)
        assert len(message["kept"]) > 300_000
        assert tracemalloc.get_traced_memory()[1] < 64 * 1024 * 1024
    finally:
        tracemalloc.stop()
