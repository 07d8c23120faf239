# Generated from speech.cdsl by rcgen 0.1.0: edits are lost.
"""The ports of speech, and the methods that its SpecificWorker must define."""

from __future__ import annotations

from abc import abstractmethod

from robocomp_py.runtime.api import Component, Port, Verb, Worker

from . import RoboCompSpeech
from .params import PARAMS, Params


class GenericWorker(Worker[Params]):
    """Base of SpecificWorker: proxies are attributes, handlers are abstract methods."""

    component = Component(
        "speech",
        ports=(Port(Verb.IMPLEMENTS, RoboCompSpeech.SPEECH_INTERFACE),),
        params=PARAMS,
        period=0.1,
        description="A voice that speaks in the log.",
    )
    middleware = "auto"

    @abstractmethod
    def Speech_say(self, text: str, overwrite: bool) -> bool:
        """Say something: whether it was accepted. With `overwrite`, it replaces what is
        being said.

        IDSL: bool say(string text, bool overwrite)
        """

    @abstractmethod
    def Speech_isBusy(self) -> bool:
        """Whether something is being said.

        IDSL: bool isBusy()
        """
