"""A voice that is written in the log."""

from __future__ import annotations

from .generic.genericworker import GenericWorker
from .generic.RoboCompSpeech import dataenableSynchronization, dataresponse, datasayin


class SpecificWorker(GenericWorker):
    """Says a text at once, however long it is."""

    def initialize(self) -> None:
        self.said = dataresponse()

    def compute(self) -> None:
        """Nothing: it speaks when it is asked to."""

    def Speech_say(self, pin: datasayin) -> dataresponse:
        self.said = dataresponse(ok=True, text=pin.text)
        return self.said

    def Speech_isBusy(self) -> dataresponse:
        return self.said

    def Speech_enableSynchronization(self, pin: dataenableSynchronization) -> None:
        self.log.info("synchronized" if pin.enable else "not synchronized")

    def Speech_stop(self) -> None:
        self.said = dataresponse()
