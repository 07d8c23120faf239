# Generated from speech.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of speech, and the methods its SpecificWorker has to write."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import RoboCompSpeech
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are methods to write."""

    component = Component(
        "speech",
        ports=(Port(Verb.IMPLEMENTS, RoboCompSpeech.SPEECH_INTERFACE),),
        params=PARAMS,
        period=0.1,
        description="A voice that speaks in the log.",
    )
    middleware = "zeromq"

    @abstractmethod
    def Speech_say(self, pin: RoboCompSpeech.datasayin) -> RoboCompSpeech.dataresponse:
        """Begin to say something; not `ok` if something else is being said and may not
        be broken off.

        IDSL: [query] void say(datasayin pin, out dataresponse pout)
        """

    @abstractmethod
    def Speech_isBusy(self) -> RoboCompSpeech.dataresponse:
        """Whether something is being said.

        IDSL: [query] void isBusy(out dataresponse pout)
        """

    @abstractmethod
    def Speech_enableSynchronization(
        self,
        pin: RoboCompSpeech.dataenableSynchronization,
    ) -> None:
        """Show words as they are said, or the whole text when it begins.

        IDSL: [command] void enableSynchronization(dataenableSynchronization pin)
        """

    @abstractmethod
    def Speech_stop(self) -> None:
        """Be silent at once.

        IDSL: [command] void stop()
        """
