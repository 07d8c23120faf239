"""Programs that tests start are heard to the end."""

from __future__ import annotations

import pytest

from robocomp_py.testing.patience import SOON

from .programs import Program, running


def test_what_a_program_says_last_counts_although_it_is_read_after_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    read = Program._read

    def read_late(program: Program) -> None:
        program.wait(SOON * 3)
        read(program)

    monkeypatch.setattr(Program, "_read", read_late)
    with running("rc", "--version") as program:
        program.wait_for("robocomp")
