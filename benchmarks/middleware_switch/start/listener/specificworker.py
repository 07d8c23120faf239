"""Lets another one speak, and measures how long that takes."""

from __future__ import annotations

import statistics
import time

from .generic.genericworker import GenericWorker
from .generic.RoboCompSpeech import datasayin


class SpecificWorker(GenericWorker):
    """Ends when it has asked often enough. The first answers are not counted: connections are made meanwhile."""

    warm_up, calls = 200, 2000

    def initialize(self) -> None:
        self.seconds: list[float] = []

    def compute(self) -> None:
        number = len(self.seconds)
        text = f"This is text number {number}."
        begun = time.perf_counter()
        answer = self.speech_proxy.say(datasayin(text=text))
        self.seconds.append(time.perf_counter() - begun)
        if not (answer.ok and answer.text == text):
            raise RuntimeError(f"said {answer.text!r} instead of {text!r}")
        if number == self.warm_up + self.calls:
            self.log.info("a median of %.1f µs", 1e6 * statistics.median(self.seconds[self.warm_up :]))
            self.stop()
