"""A voice: says things in the log, a word at a time.

Yours: rcgen wrote this file once and never touches it again.
"""

from __future__ import annotations

from .generic import RoboCompSpeech
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """No two methods here ever run at once. While one waits for an answer from another
    component, a handler may run.
    """

    def initialize(self) -> None:
        """Called once, when the components required are there."""

    def compute(self) -> None:
        """Called every 100 ms."""

    def Speech_say(self, pin: RoboCompSpeech.datasayin) -> RoboCompSpeech.dataresponse:
        """Begin to say something; not `ok` if something else is being said and may not
        be broken off.

        IDSL: [query] void say(datasayin pin, out dataresponse pout)
        """
        return RoboCompSpeech.dataresponse()

    def Speech_isBusy(self) -> RoboCompSpeech.dataresponse:
        """Whether something is being said.

        IDSL: [query] void isBusy(out dataresponse pout)
        """
        return RoboCompSpeech.dataresponse()

    def Speech_enableSynchronization(
        self,
        pin: RoboCompSpeech.dataenableSynchronization,
    ) -> None:
        """Show words as they are said, or the whole text when it begins.

        IDSL: [command] void enableSynchronization(dataenableSynchronization pin)
        """

    def Speech_stop(self) -> None:
        """Be silent at once.

        IDSL: [command] void stop()
        """
