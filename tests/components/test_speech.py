from __future__ import annotations

import logging

import pytest
from speech.generic.RoboCompSpeech import dataenableSynchronization, dataresponse, datasayin
from speech.specificworker import SpecificWorker

from robocomp_py.testing.components import ComponentTest

FAST = {"component.period": 0.002}
SLOW = {"component.period": 1.0, "params.computes_per_word": 100}
"""No word is over before a test is."""


def say(component: ComponentTest, text: str, *, overwrite: bool = False) -> dataresponse:
    answer: dataresponse = component.call("Speech.say", datasayin(text, overwrite))
    return answer


def is_busy(component: ComponentTest) -> bool:
    return bool(component.call("Speech.isBusy").busy)


def test_it_is_busy_until_everything_is_said() -> None:
    with ComponentTest(SpecificWorker, FAST) as component:
        assert not is_busy(component)
        assert say(component, "help is near") == dataresponse(ok=True, busy=True, text="help is near")
        component.wait_for(lambda: not is_busy(component))
    assert component.fine


class Counting(SpecificWorker):
    """Counts the computes at which it was busy."""

    busy = 0

    def compute(self) -> None:
        super().compute()
        self.busy += bool(self.text)


def test_every_word_takes_as_many_computes_as_configured() -> None:
    with ComponentTest(Counting, {**FAST, "params.computes_per_word": 5}) as component:
        say(component, "one two three")
        component.wait_for(lambda: not is_busy(component))
        assert component.worker.busy == 3 * 5


def test_what_is_being_said_is_not_broken_off() -> None:
    with ComponentTest(SpecificWorker, SLOW) as component:
        say(component, "first")
        assert say(component, "second") == dataresponse(ok=False, busy=True, text="first")


def test_what_is_being_said_is_broken_off_if_wanted() -> None:
    with ComponentTest(SpecificWorker, SLOW) as component:
        say(component, "first")
        assert say(component, "second", overwrite=True).text == "second"


def test_stop_silences_it() -> None:
    with ComponentTest(SpecificWorker, SLOW) as component:
        say(component, "first second third")
        component.send("Speech.stop")
        component.wait_for(lambda: not is_busy(component))
        assert say(component, "again").ok


def test_a_text_is_shown_at_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), ComponentTest(SpecificWorker, FAST) as component:
        say(component, "help is near")
    assert "help is near" in caplog.messages


def test_with_synchronization_words_are_shown_as_they_are_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), ComponentTest(SpecificWorker, FAST) as component:
        component.send("Speech.enableSynchronization", dataenableSynchronization(True))
        component.wait_for(lambda: component.worker.word_by_word)
        say(component, "help is near")
        component.wait_for(lambda: not is_busy(component))
    assert [message for message in caplog.messages if message != "ready"] == ["help …", "is …", "near"]
