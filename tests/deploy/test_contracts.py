"""Contracts of a running network, compared: pure decisions."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.contracts import BrokenLink, RestartEffect, broken_links, effect_of_restart, outdated
from robocomp_py.deploy.launcher.notes import MOST_OPERATIONS, Contract, read
from robocomp_py.runtime.notify import contract

OLD, NEW = {"M::I.ask": "1" * 16}, {"M::I.ask": "2" * 16}
MORE = {**OLD, "M::I.tell": "3" * 16}
LINKS = [
    {"interface": "I", "provider": "server", "client": "one", "verb": "requires"},
    {"interface": "I", "provider": "server", "client": "two", "verb": "requires"},
]


def test_a_restart_with_a_new_contract_names_the_linked_instances() -> None:
    running = dict.fromkeys(("server", "one", "two"), OLD)
    current = dict.fromkeys(running, NEW)
    link = BrokenLink("I", "server", "one")
    assert effect_of_restart(LINKS, running, current, ["one"]) == RestartEffect((link,), ("server", "two"))
    assert effect_of_restart(LINKS, running, current, list(running)) == RestartEffect((), ())


def test_a_component_that_is_not_generated_anew_is_not_restarted_along() -> None:
    running = dict.fromkeys(("server", "one", "two"), OLD)
    assert effect_of_restart(LINKS, running, {"server": OLD, "one": NEW}, ["one"]).together == ()


def test_what_is_broken_already_may_be_restarted() -> None:
    running = {"server": NEW, "one": OLD}
    assert broken_links(LINKS, running) == [BrokenLink("I", "server", "one")]
    assert effect_of_restart(LINKS, running, running, ["one"]) == RestartEffect((), ())


def test_an_operation_that_is_added_is_newer_but_hurts_clients_only_that_call_it() -> None:
    assert broken_links(LINKS, {"server": MORE, "one": OLD}) == []
    assert broken_links(LINKS, {"server": OLD, "one": MORE}) == [BrokenLink("I", "server", "one")]
    assert outdated({"server": OLD, "one": OLD}, {"server": MORE, "one": OLD}) == {"server": ["I"]}


def test_a_process_says_what_its_components_run_and_nonsense_is_passed_over() -> None:
    told = b"X_ROBOCOMP_CONTRACT=a 1 M::I.ask=" + b"1" * 16 + b" M::I.tell=x =\nX_ROBOCOMP_CONTRACT=\n"
    note = read(told + b"X_ROBOCOMP_CONTRACT=a many\nREADY=1")
    assert note.ready
    assert [(each.instance, each.operations, each.complete) for each in note.contracts] == [("a", OLD, True)]


@given(st.dictionaries(st.from_regex(r"[A-Za-z:]{1,60}\.[a-z]{1,200}", fullmatch=True), st.just("0" * 16)))
def test_a_contract_of_any_size_is_known_once_all_its_datagrams_have_come_in_any_order(
    operations: dict[str, str],
) -> None:
    lines = list(contract("arm", operations))
    known = Contract("arm", 0, {})
    for line in reversed(lines):
        assert len(line) <= 4096
        assert not known.operations or not known.complete
        (part,) = read(line.encode()).contracts
        known.add(part)
    assert known.complete
    assert known.operations == operations


def test_a_contract_that_is_no_contract_takes_no_more_memory_than_one() -> None:
    known = Contract("arm", 0, {})
    for number in range(50):
        known.add(Contract("arm", 10**9, {f"M::I.o{number}_{each}": "" for each in range(1000)}))
    assert len(known.operations) == MOST_OPERATIONS
    assert not known.complete
    known.add(Contract("arm", 3, {"M::I.more": ""}))
    assert len(known.operations) == MOST_OPERATIONS
    assert not known.complete
