"""What the transport takes from Ice beyond its public interface, or does without."""

from __future__ import annotations

from types import SimpleNamespace

from robocomp_py.transports.ice import unsafe


def test_a_request_that_was_sent_is_freed() -> None:
    sending = SimpleNamespace(_asyncResult=object())
    unsafe.free(sending)
    assert sending._asyncResult is None


def test_a_request_of_another_version_stays_as_it_is() -> None:
    sending = SimpleNamespace()
    unsafe.free(sending)
    assert vars(sending) == {}
