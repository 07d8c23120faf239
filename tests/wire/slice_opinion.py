"""Ice itself: what code that it makes of our Slice writes and reads, by Ice's own marshalling.

Nothing here knows the encoding. What a generated proxy sends is kept by a servant that takes anything, and what it
reads is what that servant answers; generated servants are asked in octets, and answer in octets.
"""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import Ice

from robocomp_py.contract.interface import Operation
from robocomp_py.contract.types import (
    INT8,
    UINT8,
    Dictionary,
    Enumeration,
    Primitive,
    Sequence,
    Struct,
    Type,
)

from ..codegen.exported import in_format

Answer = tuple[bool, bytes]
"""Whether it is a result, or else an exception; and its octets."""


class Generated:
    """Modules that Ice makes of Slice. They are in `sys.modules` until they are closed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._before: dict[str, ModuleType | None] = {}
        self._names = (f"Opinion{number}" for number in itertools.count())  # Ice never forgets a type

    def of_idsl(self, idsl: str) -> Any:
        """The module of this text, in which it has the name `Any`."""
        name = next(self._names)
        texts, said = in_format(self._folder, idsl.replace("module Any", f"module {name}", 1), "slice")
        assert set(said) <= {"lossy-in-slice"}
        self.load(texts)
        return self[name]

    def load(self, texts: Mapping[str, str]) -> None:
        for path, text in texts.items():
            (self._folder / path).write_text(text, encoding="utf-8")
        for path, text in texts.items():
            for module in re.findall(r"^module (\w+)", text, re.MULTILINE):
                if module not in self._before:
                    self._before[module] = sys.modules.pop(module, None)
            Ice.loadSlice("", [f"-I{self._folder}", "--all", "--underscore", str(self._folder / path)])

    def __getitem__(self, module: str) -> Any:
        return sys.modules[module]

    def close(self) -> None:
        for name, before in self._before.items():
            del sys.modules[name]
            if before:
                sys.modules[name] = before


def in_ice(kind: Type, value: Any, module_of: Callable[[str], Any]) -> Any:
    """A value of ours as generated code has it."""

    def inside(item: Type, part: Any) -> Any:
        return in_ice(item, part, module_of)

    match kind:
        case Struct(name=name, fields=fields):
            parts = value if isinstance(value, tuple) else [getattr(value, field.attribute) for field in fields]
            made = [inside(field.type, part) for field, part in zip(fields, parts, strict=True)]
            return _named(name, module_of)(*made)
        case Enumeration(name=name):
            return _named(name, module_of).valueOf(int(value))
        case Sequence(item) if item in (INT8, UINT8):
            return value.tobytes()
        case Sequence(item):
            return [inside(item, each) for each in (value if kind.dtype is None else value.tolist())]
        case Dictionary(key, item):
            return {inside(key, k): inside(item, v) for k, v in value.items()}
        case Primitive.INT8:
            return value & 0xFF
        case Primitive.UINT64:
            return (value ^ 1 << 63) - (1 << 63)
        case Primitive():
            return value


def _named(name: str, module_of: Callable[[str], Any]) -> Any:
    module, _, short = name.rpartition("::")
    return getattr(module_of(module), short)


class _Keeper(Ice.Blobject):  # type: ignore[misc]  # Ice has no types
    """Takes anything."""

    def __init__(self) -> None:
        self.asked = b""
        self.answer: Answer = (True, b"")

    def ice_invoke(self, octets: bytes, current: Any) -> Answer:
        self.asked = octets
        return self.answer


class Loopback:
    """Ice in one process, without a socket; it throws in slices that tell their size, or as it usually does."""

    def __init__(self, *, sliced: bool = False) -> None:
        data = Ice.InitializationData()
        data.properties = Ice.createProperties()
        data.properties.setProperty("Ice.Default.SlicedFormat", str(int(sliced)))
        data.properties.setProperty("Ice.Warn.Dispatch", "0")
        self._communicator = Ice.initialize(data)
        self._adapter = self._communicator.createObjectAdapter("")
        self._adapter.activate()
        self._keeper = _Keeper()
        self._kept = self._adapter.addWithUUID(self._keeper)

    def close(self) -> None:
        self._communicator.destroy()

    def sent(self, proxy: Any, operation: str, arguments: list[Any], answer: bytes) -> tuple[bytes, Any]:
        """The octets that a generated proxy sends, and what it makes of those that are its answer."""
        self._keeper.answer = (True, answer)
        result = getattr(proxy.uncheckedCast(self._kept), operation)(*arguments)
        return self._keeper.asked, result

    def thrown(self, proxy: Any, operation: str, answer: bytes) -> Any:
        """What a generated proxy raises if those octets are thrown by an operation without arguments."""
        self._keeper.answer = (False, answer)
        try:
            getattr(proxy.uncheckedCast(self._kept), operation)()
        except Ice.Exception as exc:
            return exc
        raise AssertionError("nothing was raised")

    def answered(self, base: Any, operation: Operation[Any], method: Callable[..., Any], octets: bytes) -> Answer:
        """The octets that a servant of that generated class answers to those."""
        mode = Ice.OperationMode.Idempotent if operation.idempotent else Ice.OperationMode.Normal
        servant = type("Servant", (base,), {operation.name: lambda self, *arguments: method(*arguments[:-1])})()
        proxy = self._adapter.addWithUUID(servant)
        try:
            answer: Answer = proxy.ice_invoke(operation.name, mode, octets)
            return answer
        finally:
            self._adapter.remove(proxy.ice_getIdentity())
