"""Files that a component left open are written out; where objects cannot be searched, nothing happens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robocomp_py.runtime import unsafe

MISSING: Any = None


def test_objects_can_be_searched() -> None:
    assert unsafe._all_objects is not None


def test_a_file_that_was_left_open_is_written_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "left open"
    with path.open("w") as file:
        file.write("text")
        with monkeypatch.context() as other:
            other.setattr(unsafe, "_all_objects", MISSING)
            unsafe.write_out()
        assert path.read_text() == ""
        unsafe.write_out()
        assert path.read_text() == "text"
