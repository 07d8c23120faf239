from __future__ import annotations

import logging

import pytest
from speech.specificworker import SpecificWorker

from robocomp_py.testing.components import ComponentTest

FAST = {"component.period": 0.002}
SLOW = {"component.period": 1.0, "params.computes_per_word": 100}
"""No word is over before a test is."""


def say(component: ComponentTest, text: str, *, overwrite: bool = False) -> bool:
    return component.call("Speech.say", text, overwrite) is True


def is_busy(component: ComponentTest) -> bool:
    return component.call("Speech.isBusy") is True


def test_it_is_busy_until_everything_is_said() -> None:
    with ComponentTest(SpecificWorker, FAST, virtual=True) as component:
        assert not is_busy(component)
        assert say(component, "help is near")
        assert is_busy(component)
        component.wait_for(lambda: not is_busy(component))
    assert component.fine


class Counting(SpecificWorker):
    """Counts the computes at which it was busy."""

    busy = 0

    def compute(self) -> None:
        super().compute()
        self.busy += bool(self.text)


def test_every_word_takes_as_many_computes_as_configured() -> None:
    with ComponentTest(Counting, {**FAST, "params.computes_per_word": 5}, virtual=True) as component:
        say(component, "one two three")
        component.wait_for(lambda: not is_busy(component))
        assert component.worker.busy == 3 * 5


def test_what_is_being_said_is_not_broken_off() -> None:
    with ComponentTest(SpecificWorker, SLOW, virtual=True) as component:
        assert say(component, "first")
        assert not say(component, "second")
        assert component.worker.text == "first"


def test_what_is_being_said_is_broken_off_if_wanted() -> None:
    with ComponentTest(SpecificWorker, SLOW, virtual=True) as component:
        assert say(component, "first")
        assert say(component, "second", overwrite=True)
        assert component.worker.text == "second"


def test_words_are_shown_as_they_are_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), ComponentTest(SpecificWorker, FAST, virtual=True) as component:
        say(component, "help is near")
        component.wait_for(lambda: not is_busy(component))
    assert [message for message in caplog.messages if message != "ready"] == ["help …", "is …", "near"]
