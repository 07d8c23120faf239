"""Tests of what failed tests leave behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]

FAILING = """
import subprocess
import sys
import threading
from pathlib import Path

import pytest

END, FOREVER = threading.Event(), [sys.executable, "-ISc", "import time; time.sleep(600)"]


@pytest.fixture(scope="module")
def shared():
    with subprocess.Popen(FOREVER) as process:
        yield process
        process.kill()


def go_on():
    END.wait(600)


def test_that_fails(shared):
    started.append(subprocess.Popen(FOREVER))
    threading.Thread(target=go_on).start()
    assert 1 == 2


def test_the_next_one(shared):
    END.set()
    (process,) = started
    assert process.wait() == -9
    assert shared.poll() is None


started = []
"""


def test_a_failed_test_names_what_it_leaves_and_its_processes_are_killed_but_none_that_tests_share(
    tmp_path: Path,
) -> None:
    (tmp_path / "test_it.py").write_text(FAILING)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "tests.leftovers",
        "-p",
        "no:cacheprovider",
        "-c",
        "/dev/null",
    ]
    done = subprocess.run([*command, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "1 failed, 1 passed" in done.stdout
    assert "killed now: " in done.stdout
    assert "(go_on), which runs on" in done.stdout
