"""Named instances in generated code: the classes that answer for them, and the attributes that hold them."""

from __future__ import annotations

from typing import Any

from ..contract.component import Port
from ..contract.interface import Operation
from .expressions import hint, returns
from .layout import WIDTH, signature
from .names import argument, handler_class, module_name, proxy_class
from .shadows import Shadows


def named_attribute(port: Port) -> str:
    """`laser: NamedHandlers[LaserHandler]`."""
    proxy = f"{module_name(port.interface.module)}.{proxy_class(port)}"
    kind, item = ("NamedProxies", proxy) if port.verb.has_proxy else ("NamedHandlers", handler_class(port))
    line = f"{port.attribute}: {kind}[{item}]"
    return line if len(line) + 4 <= WIDTH else f"{port.attribute}: {kind}[\n        {item}\n    ]"


def named_handler_doc(port: Port) -> str:
    add = f"self.{port.attribute}.add(name, handler)"
    return f"Answers for one `{port.interface.short}`. Derive a class from it, and add an object of it: {add}."


def named_shadows(port: Port) -> Shadows:
    """The names that the methods of such a class hide from later methods."""
    shadows = Shadows()
    for operation, _ in port.interface.under(port.verb):
        hints = [hint(field.type, "") for field in operation.inputs]
        shadows.member(port.handler(operation.name), " ".join((*hints, returns(operation, ""))))
    return shadows


def named_signature(port: Port, operation: Operation[Any], shadows: Shadows) -> str:
    """`def getLaserData(self) -> RoboCompLaser.TLaserData:`."""
    arguments = ["self", *(f"{argument(f)}: {shadows.avoid(hint(f.type, ''))}" for f in operation.inputs)]
    return signature(port.handler(operation.name), arguments, shadows.avoid(returns(operation, "")))


def named_class(port: Port) -> str:
    """The name of the class with which a new component begins."""
    return f"One{port.interface.short}"


def named_adding(port: Port) -> str:
    """How to add an instance, for readers."""
    given = "" if port.verb.has_proxy else f", {named_class(port)}()"
    return f'self.{port.attribute}.add("front"{given})'
