"""What did not change is made once; what is made never refers to what was there before."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.memory import Memory
from robocomp_py.dsl.workspace import Workspace

PATH = Path("/models/Arm.idsl")
WRONG = b"module Arm { struct S { Jont j; }; struct T { int i };"


def test_the_same_is_made_once_and_reported_every_time() -> None:
    memory, made = Memory(), list[str]()
    same = object()

    def make(report: Report) -> int:
        made.append("made")
        return len(made)

    results = [memory.recall("key", given, make, Report()) for given in (same, same, object())]
    assert results == [1, 1, 2]


def test_a_workspace_with_the_memory_of_another_one_says_the_same() -> None:
    memory = Memory()
    said = [rendered(WRONG, memory) for _ in range(2)]
    assert said[0] == said[1] != []


def test_a_text_that_comes_back_is_checked_like_a_new_one() -> None:
    memory = Memory()
    first = rendered(WRONG, memory)
    Workspace(read=lambda path: b"module Arm {};", memory=memory).source(PATH)
    assert rendered(WRONG, memory) == first


def rendered(text: bytes, memory: Memory) -> list[str]:
    workspace = Workspace(read=lambda path: text, middlewares=(), memory=memory)
    workspace.check(PATH)
    return [each.render() for each in workspace.report.diagnostics]
