"""`Introspection`, which every component implements beside `CommonBehavior`: what it is, what it has counted, and
what it calls and logs.

Hardly any component is asked, so a start pays for the port only. Types, and the module that answers, are imported with
the first call. Until then the fields of the types are not known, but the texts of the contracts are.
"""

from __future__ import annotations

import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation, Verb
from ..contract.types import BOOL, FLOAT32, STRING, Field, Struct
from .introspected import TEXTS

if TYPE_CHECKING:
    from .commonbehavior import CommonBehavior
    from .describing import Describable, Describing
    from .RoboCompIntrospection import Description, Measures

NAME = "RoboCompIntrospection::Introspection"


class Introspection:
    """Handlers of the interface for one component. They run concurrently with its code and return quickly."""

    def __init__(self, running: Describable, behavior: CommonBehavior) -> None:
        self._running, self._behavior = running, behavior
        self._making = threading.Lock()
        self._made: Describing | None = None

    def Introspection_describe(self) -> Description:
        return self._describing.description()

    def Introspection_measure(self) -> Measures:
        return self._describing.measures()

    def Introspection_setLogLevel(self, logger: str, level: str) -> None:
        self._describing.set_log_level(logger, level)

    def Introspection_watch(self, calls: bool, logs: bool, lease: float) -> None:
        self._describing.watch(calls, logs, lease)

    def close(self) -> None:
        """End what others have asked for. Idempotent."""
        with self._making:
            made = self._made
        if made:
            made.close()

    @property
    def _describing(self) -> Describing:
        from .describing import Describing  # with the first call

        with self._making:
            self._made = self._made or Describing(self._running, self._behavior)
            return self._made


class _Later(Struct):
    """A struct whose fields are imported when they are read first."""

    def __init__(self, name: str) -> None:
        vars(self)["name"] = name

    @property
    def fields(self) -> tuple[Field, ...]:
        return self._real.fields

    @property
    def python(self) -> type[Any] | None:
        return self._real.python

    @cached_property
    def _real(self) -> Struct:
        from . import RoboCompIntrospection

        found: Struct = getattr(RoboCompIntrospection, self.name.rpartition("::")[2]).__contract__
        return found


def _query(name: str, result: str) -> Operation[Any]:
    operation: Operation[Any] = Operation(NAME, name, outputs=(Field("ret", _Later(result)),), idempotent=True)
    vars(operation)["text"] = TEXTS[name]  # otherwise it would be made from all fields
    return operation


INTERFACE = Interface(
    NAME,
    (
        _query("describe", "RoboCompIntrospection::Description"),
        _query("measure", "RoboCompIntrospection::Measures"),
        Operation(NAME, "setLogLevel", (Field("logger", STRING), Field("level", STRING))),
        Operation(
            NAME,
            "watch",
            (Field("calls", BOOL), Field("logs", BOOL), Field("lease", FLOAT32)),
            idempotent=True,
        ),
    ),
)
"""As the generated one, but for the classes of its types."""


def port_of(component: Component) -> Port | None:
    """The port of Introspection; None if the component implements an interface of that name itself."""
    taken = any(p.interface.short == INTERFACE.short and not p.verb.has_proxy for p in component.ports)
    return None if taken else Port(Verb.IMPLEMENTS, INTERFACE, concurrent=True)
