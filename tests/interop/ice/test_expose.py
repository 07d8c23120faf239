"""A virtual environment sees the Ice of the system's Python, and nothing else of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON

from .expose import SYSTEM

pytestmark = pytest.mark.tool

EXPOSE = Path(__file__).parent / "expose.py"


def run(*command: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=SOON * 12)


def test_ice_can_be_imported_and_nothing_else_and_a_second_time_changes_nothing(tmp_path: Path) -> None:
    assert run(sys.executable, "-m", "venv", "--without-pip", "own", cwd=tmp_path).returncode == 0
    python = tmp_path / "own" / "bin" / "python"
    for _ in range(2):
        done = run(sys.executable, EXPOSE, "own", cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        assert run(python, "-c", "import Ice, IceStorm; print(Ice.stringVersion())").stdout.startswith("3.7.")
    others = run(SYSTEM, "-c", "import pip").returncode == 0
    assert not others or run(python, "-c", "import pip").returncode == 1


def test_an_invalid_environment_is_reported(tmp_path: Path) -> None:
    done = run(sys.executable, EXPOSE, tmp_path)
    assert (done.returncode, "is not a virtual environment; make one" in done.stderr) == (1, True)


def test_an_environment_with_an_ice_of_its_own_is_left_alone(tmp_path: Path) -> None:
    assert run(sys.executable, "-m", "venv", "--without-pip", "own", cwd=tmp_path).returncode == 0
    [site] = (tmp_path / "own").glob("lib/python*/site-packages")
    (site / "IcePy.cpython-311.so").write_bytes(b"")
    assert run(sys.executable, EXPOSE, "own", cwd=tmp_path).returncode == 0
    assert [each.name for each in site.iterdir() if each.is_symlink()] == []


def test_choosing_ice_without_its_package_names_what_to_install() -> None:
    program = "import sys; sys.modules['Ice'] = None\nfrom robocomp_py.transports.base import find_transport as find"
    done = run(sys.executable, "-c", f"{program}\ntry: find('ice')\nexcept Exception as exc: print(repr(exc))")
    assert "ConfigurationError(\"middleware 'ice' is not usable here: Ice for Python is not installed" in done.stdout
    assert "`pip install 'robocomp-py[ice]'`, or Debian's package python3-zeroc-ice" in done.stdout
