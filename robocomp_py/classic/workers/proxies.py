"""Proxies with the interface of Ice's: positional arguments, lists instead of arrays, exceptions of Ice."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, Protocol

from ...contract.component import Port
from ...contract.interface import Interface, Operation, Pattern
from ...errors import RobocompError
from ...runtime.ports import Proxy
from .ice import Ices
from .slices import receiving, settling
from .spellings import AS_IT_IS, WITH_DEADLINE, slice_name


class Loop(Protocol):
    """The loop of a component whose code must run on one thread."""

    def wait_for(self, function: Callable[[], Any]) -> Any:
        """Call a blocking function while the component's other code may run."""

    def post(self, call: Callable[[], object]) -> None:
        """Queue a call for that thread."""


def proxy_class(interface: Interface, port: Port, ices: Ices) -> type[Proxy]:
    """The class of a port's proxies. If the component has a loop, set `_loop`."""
    methods: dict[str, Any] = {
        "interface": interface,
        "_deadline": None,
        "_loop": None,
        **dict.fromkeys(WITH_DEADLINE, _with_deadline),
        **dict.fromkeys(AS_IT_IS, lambda self, *arguments: self),
    }
    for operation, pattern in interface.under(port.verb):
        name = slice_name(operation.name)
        call = _Call(operation, ices)
        if pattern is Pattern.QUERY:
            methods[name] = _method(call, call.ask)
            methods[f"{operation.name}Async"] = methods[f"begin_{operation.name}"] = _later(call)
            methods[f"end_{operation.name}"] = lambda self, answer: answer.result()
        else:
            methods[name] = _method(call, call.send)
    return type(f"{interface.short}Prx", (Proxy,), methods)


def _with_deadline(self: Any, milliseconds: int) -> Any:
    """The same proxy with a time limit; with -1, the configured limit."""
    copy = type(self)(self._bound)
    copy._deadline = milliseconds / 1000 if milliseconds > 0 else None
    copy._loop = self._loop
    return copy


class _Call:
    """One operation, callable."""

    def __init__(self, operation: Operation[Any], ices: Ices) -> None:
        self.operation, self._ices = operation, ices
        self._names = [slice_name(each.name) for each in operation.inputs]
        self._settle = settling(operation.inputs)
        self._receive = receiving(operation.outputs)

    def ask(self, proxy: Any, arguments: tuple[Any, ...]) -> Any:
        if proxy._loop is None:
            return self.given(proxy._ask(self.operation, arguments, proxy._deadline))
        return self.given(proxy._loop.wait_for(lambda: proxy._ask(self.operation, arguments, proxy._deadline)))

    def send(self, proxy: Any, arguments: tuple[Any, ...]) -> None:
        proxy._send(self.operation, arguments, proxy._deadline)

    def given(self, result: Any) -> Any:
        """The result, or a tuple of several, with slice2py's types."""
        if self._receive is None:
            return result
        if len(self._receive) == 1:
            return self._receive[0](result)
        return tuple(convert(each) for convert, each in zip(self._receive, result, strict=True))

    def taken(self, arguments: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, ...]:
        """The arguments in order. Raises TypeError for wrong ones."""
        context = named.pop("context", None)  # Ice's optional last argument is ignored
        number = len(self._names)
        if len(arguments) == number + 1 and context is None and isinstance(arguments[-1], dict | None):
            arguments = arguments[:-1]
        if named:
            rest = self._names[len(arguments) :]
            if sorted(rest) == sorted(named):
                arguments = (*arguments, *(named[name] for name in rest))
        if len(arguments) != number:
            takes = ", ".join(self._names) or "nothing"
            raise TypeError(f"{self.operation.name} takes {takes}, and was given {len(arguments) + len(named)}")
        return tuple(convert(each) for convert, each in zip(self._settle, arguments, strict=True))

    def raised(self, exc: RobocompError) -> RobocompError:
        return self._ices.raised(exc)


def _method(call: _Call, do: Callable[[Any, tuple[Any, ...]], Any]) -> Callable[..., Any]:
    def method(self: Any, *arguments: Any, **named: Any) -> Any:
        values = call.taken(arguments, named)
        try:
            return do(self, values)
        except RobocompError as exc:
            call.raised(exc)
            raise

    method.__name__ = method.__qualname__ = call.operation.name
    method.__doc__ = call.operation.source
    return method


def _later(call: _Call) -> Callable[..., Any]:
    def method(self: Any, *arguments: Any, **named: Any) -> Any:
        values = call.taken(arguments, named)
        try:
            return _Answer(call, self._ask_async(call.operation, values, self._deadline), self._loop)
        except RobocompError as exc:
            call.raised(exc)
            raise

    method.__name__ = method.__qualname__ = f"{call.operation.name}Async"
    return method


class _Answer:
    """The result of an asynchronous call, with the methods of Ice's future and AsyncResult."""

    def __init__(self, call: _Call, future: Future[Any], loop: Loop | None) -> None:
        self._call, self._future, self._loop = call, future, loop

    def _wait(self, function: Callable[[], Any]) -> Any:
        return self._loop.wait_for(function) if self._loop else function()

    def result(self, timeout: float | None = None) -> Any:
        try:
            return self._call.given(self._wait(lambda: self._future.result(timeout)))
        except RobocompError as exc:
            self._call.raised(exc)
            raise

    def exception(self, timeout: float | None = None) -> BaseException | None:
        exc: BaseException | None = self._wait(lambda: self._future.exception(timeout))
        return self._call.raised(exc) if isinstance(exc, RobocompError) else exc

    def done(self) -> bool:
        return self._future.done()

    isCompleted = done

    def cancel(self) -> bool:
        return self._future.cancel()

    def cancelled(self) -> bool:
        return self._future.cancelled()

    def running(self) -> bool:
        return not self._future.done()

    def add_done_callback(self, function: Callable[[_Answer], object]) -> None:
        loop, call = self._loop, partial(function, self)
        self._future.add_done_callback(lambda _: loop.post(call) if loop else call())

    def waitForCompleted(self) -> None:
        self.exception()


def handler(operation: Operation[Any]) -> Callable[[Callable[..., Any], tuple[Any, ...]], Any]:
    """A handler that calls a function with slice2py's types of arguments."""
    receive, settle = receiving(operation.inputs), settling(operation.outputs)

    def handle(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        if receive:
            arguments = tuple(convert(each) for convert, each in zip(receive, arguments, strict=True))
        result = function(*arguments)
        if not settle:
            return None  # Ice ignores the result of a void operation
        if len(settle) == 1:
            return settle[0](result)
        if isinstance(result, tuple) and len(result) == len(settle):
            return tuple(convert(each) for convert, each in zip(settle, result, strict=True))
        return result

    return handle
