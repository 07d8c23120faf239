"""Contracts: two ends that disagree about a type report it, and no message passes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from ...errors import ContractMismatch
from ...transports.base import Transport
from ..parts import OTHER, Inbox, TransportSuite, answering, asker, greet, put, query, subscribe, topic
from ..patience import SOON, wait_until


class ContractsConformance(TransportSuite):
    @pytest.mark.parametrize("instance", ["named", "any"])
    def test_another_contract_is_named_and_calls_do_not_pass(
        self, here: Transport, there: Transport, name: str, instance: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        name, looked_up = _in_a_namespace(name, instance)
        executed = Inbox()
        server = here.server(query(name), answering(here, _noting(executed)))
        caller = there.caller(replace(query(looked_up), type=OTHER))
        with pytest.raises(ContractMismatch, match=r"data: sequence<int16> here, sequence<uint8> there"):
            caller.wait_peer(SOON)
        with pytest.raises(ContractMismatch, match=r"data: sequence<int16> here, sequence<uint8> there"):
            asker(there, caller, "ask")(b"x")
        wait_until(lambda: server.stats.mismatched > 0)
        assert executed.empty()
        assert "data: sequence<uint8> here, sequence<int16> there" in caplog.text

    @pytest.mark.parametrize("instance", ["named", "any"])
    def test_another_contract_is_named_and_messages_do_not_pass(
        self, here: Transport, there: Transport, name: str, instance: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        """Both sides report it, even if the subscriber names no instance."""
        name, looked_up = _in_a_namespace(name, instance)
        inbox, witness = Inbox(), subscribe(there, topic(name))
        link = there.inlet(replace(topic(looked_up), type=OTHER), put(there, inbox))
        outlet = here.outlet(topic(name))
        greet(here, outlet, witness)
        wait_until(lambda: link.stats.mismatched > 0 and outlet.stats.mismatched > 0)
        assert inbox.empty()
        assert "data: sequence<uint8> here, sequence<int16> there" in caplog.text
        assert "data: sequence<int16> here, sequence<uint8> there" in caplog.text


def _noting(inbox: Inbox) -> Callable[[bytes], bytes]:
    """An echo that leaves a note."""

    def note(data: bytes) -> bytes:
        inbox.put(data)
        return data

    return note


def _in_a_namespace(name: str, instance: str) -> tuple[str, str]:
    """A channel in a new namespace, and the name that a client uses for it: with this instance, or `any`."""
    namespace, interface, operation = name.split("/")
    looked_up = "*" if instance == "any" else "one"
    return f"{namespace}/one/{interface}/{operation}", f"{namespace}/{looked_up}/{interface}/{operation}"
