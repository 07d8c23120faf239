"""A voice that speaks in the log."""

from __future__ import annotations

from collections import deque

from .generic.genericworker import GenericWorker
from .generic.RoboCompSpeech import dataenableSynchronization, dataresponse, datasayin


class SpecificWorker(GenericWorker):
    """Every word takes `computes_per_word` computes; one text is said at a time."""

    def initialize(self) -> None:
        """Silent at first."""
        self.text = ""
        self.words: deque[str] = deque()
        self.pause = 0
        self.word_by_word = False

    def compute(self) -> None:
        """Say the next word, once the one before has had its time."""
        if self.pause:
            self.pause -= 1
        elif self.words:
            word = self.words.popleft()
            self.pause = self.params.computes_per_word - 1
            if self.word_by_word:
                self.log.info("%s%s", word, " …" if self.words else "")
        else:
            self.text = ""

    def Speech_say(self, pin: datasayin) -> dataresponse:
        """Begin with a text, unless another one must not be broken off."""
        if self.text and not pin.overwrite:
            return self.answer(ok=False)
        self.text, self.words, self.pause = pin.text, deque(pin.text.split()), 0
        if not self.word_by_word:
            self.log.info("%s", self.text)
        return self.answer(ok=True)

    def Speech_isBusy(self) -> dataresponse:
        return self.answer(ok=True)

    def Speech_enableSynchronization(self, pin: dataenableSynchronization) -> None:
        self.word_by_word = pin.enable

    def Speech_stop(self) -> None:
        self.text = ""
        self.words.clear()

    def answer(self, *, ok: bool) -> dataresponse:
        return dataresponse(ok=ok, busy=bool(self.text), text=self.text)
