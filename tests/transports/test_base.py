"""What all transports have in common."""

from __future__ import annotations

import pytest

from robocomp_py.contract.interface import Pattern
from robocomp_py.transports.base import LONGEST_CONTRACT, Channel, TypeRef, mismatch

MINE = Channel("robot/arm/Arm/move", Pattern.COMMAND, TypeRef("", 1, "operation Arm.move\npattern command\n"))


@pytest.mark.parametrize(
    "text",
    ["operation " + 50_000_000 * "x", "struct a\n  b c\n" * 4_000, "\n".join(f"struct a{n}" for n in range(4_000))],
)
def test_a_hostile_name_is_shortened_in_messages(text: str) -> None:
    assert len(mismatch(MINE, TypeRef("", 2, text))) < 3000


def test_what_a_hostile_program_means_by_a_name_moves_nothing_on_a_terminal() -> None:
    told = mismatch(MINE, TypeRef("", 2, "operation Arm.move\x1b[2J\npattern command\n"))
    assert told.isprintable()
    assert "Arm.move" in told


def test_a_contract_of_the_greatest_length_is_compared() -> None:
    text = "operation Arm.stop\n" + "struct a\n".ljust(LONGEST_CONTRACT - 30, "x")
    assert "Arm.stop" in mismatch(MINE, TypeRef("", 2, text))
