"""Tracebacks as the author of a component reads them."""

from __future__ import annotations

from typing import Any

import pytest

from robocomp_py.runtime.trace import user_trace


class Worker:
    laser_proxy = 1


class Telling:
    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"unknown timer `{name}`; did you mean `blink`?")


class Broken:
    def __dir__(self) -> list[str]:
        raise OSError


def shown(of: object, name: str) -> str:
    """The last line of the traceback of an attribute that is not there."""
    with pytest.raises(AttributeError) as raised:
        getattr(of, name)
    return user_trace(raised.value).splitlines()[-1]


def test_for_a_misspelt_attribute_the_one_that_was_meant_is_proposed() -> None:
    assert shown(Worker(), "lazer_proxy").endswith("has no attribute 'lazer_proxy'. Did you mean: 'laser_proxy'?")


def test_nothing_is_proposed_if_nothing_is_similar_or_the_attributes_cannot_be_listed() -> None:
    assert shown(Worker(), "camera").endswith("has no attribute 'camera'")
    assert shown(Broken(), "laser").endswith("has no attribute 'laser'")


def test_a_message_that_proposes_by_itself_stays_as_it_is() -> None:
    assert shown(Telling(), "blnk").endswith("did you mean `blink`?")
