"""A voice that speaks in the log."""

from __future__ import annotations

from collections import deque

from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    """Each word takes `computes_per_word` computes. One text is spoken at a time."""

    def initialize(self) -> None:
        """Begin silent."""
        self.text = ""
        self.words: deque[str] = deque()
        self.pause = 0

    def compute(self) -> None:
        """Say the next word when the previous word is complete."""
        if self.pause:
            self.pause -= 1
        elif self.words:
            word = self.words.popleft()
            self.pause = self.params.computes_per_word - 1
            self.log.info("%s%s", word, " …" if self.words else "")
        else:
            self.text = ""

    def Speech_say(self, text: str, overwrite: bool) -> bool:
        """Begin to say a text. Interrupts the present one only with `overwrite`."""
        if self.text and not overwrite:
            return False
        self.text, self.words, self.pause = text, deque(text.split()), 0
        return True

    def Speech_isBusy(self) -> bool:
        return bool(self.text)
