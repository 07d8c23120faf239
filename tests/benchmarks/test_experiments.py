"""The experiments of docs/explanation/experiments.md come to an end, and find what the page says they find."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.dsl_tasks.__main__ import TASKS, do
from benchmarks.dsl_tasks.project import prepare
from benchmarks.middleware_switch.__main__ import main as switch

pytestmark = pytest.mark.tool  # a shell, and minutes on a slow machine


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return prepare(tmp_path_factory.mktemp("tasks") / "start")


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.__name__.rpartition(".")[2])
def test_either_way_a_task_is_done_and_the_languages_need_no_more_lines(task, start, tmp_path):
    with_dsl, by_hand = (do(task, way, start, tmp_path / way) for way in ("with_dsl", "by_hand"))
    assert 0 < with_dsl.lines <= by_hand.lines


def test_what_a_component_is_made_of_by_hand_outlives_every_switch_of_its_middleware(capsys):
    assert switch(["--only", "ice", "zeromq", "shm", "inproc", "--rounds", "1"]) == 0
    assert "every file is what it was" in capsys.readouterr().out
