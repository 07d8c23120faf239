"""Add a library and a class: the talker waits between its words as long as people do, computed with numpy."""

from __future__ import annotations

from robocomp_py.testing.components import ComponentTest, load_component

from ..project import Project, message

TITLE = "add a library and a class"


def with_dsl(project: Project) -> None:
    """No model speaks of the modules that a component imports, so both ways are one."""
    by_hand(project)


def by_hand(project: Project) -> None:
    project.write(
        "talker/rhythm.py",
        """\
from __future__ import annotations

import numpy as np


class Rhythm:
    \"\"\"Pauses between words, in s: around `mean`, and never the same twice.\"\"\"

    def __init__(self, mean: float, seed: int) -> None:
        self.mean = mean
        self.random = np.random.default_rng(seed)

    def pauses(self, text: str) -> np.ndarray:
        return self.random.gamma(4.0, self.mean / 4.0, size=len(text.split()))
""",
    )
    project.replace(
        "talker/specificworker.py",
        "from .generic.RoboCompSpeech import dataresponse, datasayin\n",
        "from .generic.RoboCompSpeech import dataresponse, datasayin\nfrom .rhythm import Rhythm\n",
    )
    project.replace(
        "talker/specificworker.py",
        "        self.texts: list[str] = []\n",
        "        self.texts: list[str] = []\n        self.rhythm = Rhythm(mean=0.2, seed=1)\n",
    )
    project.replace(
        "talker/specificworker.py",
        '        self.log.info("%s", pin.text)\n',
        """\
        self.seconds = self.rhythm.pauses(pin.text).sum()
        self.log.info("%s (%.1f s)", pin.text, self.seconds)
""",
    )


def behaves(project: Project) -> None:
    """What is said takes time."""
    worker = load_component(project.root / "talker")
    with ComponentTest(worker) as talker:
        talker.wait_for_computes(1)
        talker.call("Speech.say", message(worker, "datasayin")("one two three"))
        assert talker.worker.seconds > 0
    assert talker.fine
