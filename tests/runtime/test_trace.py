"""Tracebacks as the author of a component reads them."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from robocomp_py.runtime.trace import place_of, user_trace
from robocomp_py.testing.patience import SOON


class Worker:
    laser_proxy = 1


class Waiting:
    def __init__(self) -> None:
        self.begun, self.ended = threading.Event(), threading.Event()

    def compute(self) -> None:
        self.wait()

    def wait(self) -> None:
        self.begun.set()
        self.ended.wait(SOON)


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


def test_the_place_of_a_thread_is_the_innermost_line_of_its_code_and_its_method() -> None:
    worker = Waiting()
    thread = threading.Thread(target=worker.compute)
    thread.start()
    assert worker.begun.wait(SOON)
    line = Waiting.wait.__code__.co_firstlineno + 2
    places = {place_of(thread.ident)}
    worker.ended.set()
    thread.join()
    assert places <= {f"Waiting.compute at {__file__}:{each}" for each in (line - 1, line)}
    assert place_of(None) == ""
