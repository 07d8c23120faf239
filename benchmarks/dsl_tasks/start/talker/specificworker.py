"""A voice that speaks in the log."""

from __future__ import annotations

from .generic.genericworker import GenericWorker
from .generic.RoboCompSpeech import dataresponse, datasayin


class SpecificWorker(GenericWorker):
    """Remembers what it said."""

    def initialize(self) -> None:
        self.texts: list[str] = []

    def compute(self) -> None:
        """Nothing: it speaks when it is asked to."""

    def Speech_say(self, pin: datasayin) -> dataresponse:
        self.texts.append(pin.text)
        self.log.info("%s", pin.text)
        return dataresponse(ok=True, text=pin.text)
