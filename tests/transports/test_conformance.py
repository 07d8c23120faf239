"""The suite as a third party meets it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_what_fails_in_the_suite_shows_its_values(tmp_path: Path) -> None:
    (tmp_path / "test_third_party.py").write_text("""
from robocomp_py.testing.conformance import assert_same

def test_it():
    assert_same([1, 2], [1, 2, 3])
""")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_third_party.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert "assert 2 == 3" in done.stdout
