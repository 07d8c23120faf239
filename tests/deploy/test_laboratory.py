"""The laboratory of tests with several hosts stays apart from other networks of this machine."""

from __future__ import annotations

from .laboratory import subnet, unused


def test_subnets_in_which_this_machine_has_addresses_are_left_out() -> None:
    number = unused("")
    taken = (subnet(number + 1), subnet(number + 2))
    addresses = [
        f"{7 + each}: rc1b{each}    inet {name}.1/24 scope global rc1b{each}" for each, name in enumerate(taken)
    ]
    assert unused("\n".join(addresses)) == number + 3


def test_subnets_begin_anew_after_the_last_one() -> None:
    assert (subnet(12_499), subnet(12_500)) == ("10.249.249", subnet(0))
