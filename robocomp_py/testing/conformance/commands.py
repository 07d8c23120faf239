"""Commands: from many senders to one receiver."""

from __future__ import annotations

import pytest

from ...errors import Unreachable
from ...transports.base import Transport
from ..parts import Inbox, TransportSuite, blob, command, drain, put
from ..patience import SOON, wait_until


class CommandsConformance(TransportSuite):
    def test_commands_arrive_once_and_in_order(self, here: Transport, there: Transport, name: str) -> None:
        inbox = Inbox()
        link = here.inlet(command(name), put(here, inbox))
        outlet = there.outlet(command(name))
        assert outlet.wait_peer(SOON)
        sent = [str(number).encode() for number in range(500)]
        for message in sent:
            outlet.send(blob(there, message))
        wait_until(lambda: inbox.qsize() == len(sent))
        assert drain(inbox) == sent
        assert (link.stats.lost, link.stats.repeated, link.stats.dropped) == (0, 0, 0)

    def test_many_may_command_one(self, here: Transport, there: Transport, name: str) -> None:
        inbox = Inbox()
        here.inlet(command(name), put(here, inbox))
        for transport, message in ((here, b"a"), (there, b"b"), (there, b"c")):
            outlet = transport.outlet(command(name))
            assert outlet.wait_peer(SOON)
            outlet.send(blob(transport, message))
        assert {inbox.get(timeout=SOON) for _ in range(3)} == {b"a", b"b", b"c"}

    def test_commands_of_any_size(self, here: Transport, there: Transport, name: str) -> None:
        inbox = Inbox()
        here.inlet(command(name), put(here, inbox))
        outlet = there.outlet(command(name))
        assert outlet.wait_peer(SOON)
        for size in (0, 4_000, 10_000, 20_000, 65_535, 65_536):
            outlet.send(blob(there, b"a" * size))
            assert inbox.get(timeout=SOON) == b"a" * size

    def test_a_command_without_a_receiver_is_unreachable(self, here: Transport, name: str) -> None:
        with pytest.raises(Unreachable):
            here.outlet(command(name)).send(blob(here, b"x"))
