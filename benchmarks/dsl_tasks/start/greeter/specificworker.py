"""Greets, again and again."""

from __future__ import annotations

from .generic.genericworker import GenericWorker
from .generic.RoboCompSpeech import datasayin


class SpecificWorker(GenericWorker):
    """Has nothing else to say."""

    greeting = "Good morning"

    def compute(self) -> None:
        self.speech_proxy.say(datasayin(text=self.greeting))
