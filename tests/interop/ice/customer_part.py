"""What the component `customer` of the tests does: it asks a workshop, and prints what it was told, in JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from robocomp_py.errors import RemoteFailure

from .generic.genericworker import GenericWorker
from .generic.RoboCompWorkshop import Missing, Quality, Tool, Trouble

HAMMER, SAW = Tool("hammer", Quality.good, 1.5), Tool("Säge", Quality.bad, 0.25)


def tell(*values: Any) -> None:
    print(json.dumps(values), flush=True)


def plain(value: Any) -> Any:
    if isinstance(value, Tool):
        return [value.name, value.quality.name, value.weight]
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


def attempt(call: Callable[[], Any]) -> Any:
    try:
        return plain(call())
    except Missing as exc:
        return ["Missing", exc.what, plain(exc.tool), exc.shelf]
    except Trouble as exc:
        return ["Trouble", exc.what]
    except RemoteFailure as exc:
        return [exc.kind, exc.reason]


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        there = self.workshop_proxy
        tell("divide", attempt(lambda: there.divide(17, 5)))
        tell("divide by zero", attempt(lambda: there.divide(1, 0)))
        tell("tools", attempt(lambda: there.tools(Quality.bad)))
        tell("good tools", attempt(lambda: there.tools(Quality.good)))
        tell("borrow", attempt(lambda: there.borrow(HAMMER)))
        tell("borrow what is missing", attempt(lambda: there.borrow(SAW)))
        tell("polish", bytes(there.polish(bytes(range(5)), True)).hex())
        tell("a megabyte", bytes(there.polish(bytes(900_000), False)) == bytes(900_000))
        tell("fail", attempt(lambda: there.fail("on purpose")))
        there.tidy(1)
        there.tidy(2)
        while there.tidied() < 2:  # another connection: it may be overtaken
            pass
        tell("tidied", there.tidied())
        self.stop()

    def compute(self) -> None: ...
