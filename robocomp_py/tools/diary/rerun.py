"""Runs the code of a component again, with what its diary says has entered it, and compares what goes out.

Only one thread runs at any time: it begins the turns that come next, one after the other. Where the diary says that a
turn waits while others run, another thread goes on with the diary, because the waits of turns need not nest.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ...contract.interface import Operation, Pattern
from ...contract.parameters import build
from ...contract.types import Field
from ...errors import ConfigurationError, RobocompError
from ...runtime import settings
from ...runtime.calls import Call
from ...runtime.lifecycle import State
from ...runtime.run import Running
from ...runtime.worker import Worker
from ...threads import NO_THREAD, start_thread
from ...transports.base import TransportFactory
from ...wire import json
from ...wire.cdr import Cdr
from . import coding
from .chance import here, observed_clocks, seeded
from .events import DiaryReader, Event, as_broken

LONGEST = 60.0
"""Seconds of the machine that a turn may take without doing anything that the diary knows."""

_NOTHING = "nothing"


@dataclass(frozen=True)
class Difference:
    """Something that goes out was not as it is now."""

    event: int
    seconds: float
    """Since the diary began."""
    what: str
    """`differentialrobot.setSpeedBase.rot was 0.3, is 0.4`."""

    def __str__(self) -> str:
        return f"at {self.seconds:.2f} s, event {self.event}: {self.what}"


@dataclass
class Result:
    """What was compared."""

    turns: int = 0
    outputs: int = 0
    differences: list[Difference] = field(default_factory=list)
    is_parted: bool = False
    """Whether the code did something else, not the same with other values, so that the rest cannot be compared."""
    seconds: float = 0.0
    """Of the diary, as far as it was compared."""
    left_out: list[str] = field(default_factory=list)
    """What cannot be run again."""


_Encode = Callable[[Any], bytes | None]


class _Over(BaseException):
    """Ends the threads of turns: no `except Exception` of user code is to catch it."""


def rerun(worker_class: type[Worker[Any]], diary: DiaryReader) -> Result:
    """Run a component against its diary. Raises ComponentError, ConfigurationError, and RecordingError."""
    with ExitStack() as end:
        end.enter_context(observed_clocks())
        end.enter_context(seeded(_number(diary.start, "seed")))
        again = _Again(worker_class, diary)
        end.callback(again.close)
        return again.run()


def _number(event: Event, name: str) -> int:
    value = event.get(name)
    return value if isinstance(value, int) else 0


class _Turn:
    """A call of the component's code. `go` is released when its thread may go on after a wait."""

    def __init__(self, number: int) -> None:
        self.number, self.thread = number, threading.current_thread()
        self.go = threading.Semaphore(0)
        self.back: Event | None = None
        """What the wait has ended with."""
        self.is_waiting = False


class _Again:
    def __init__(self, worker_class: type[Worker[Any]], diary: DiaryReader) -> None:
        self._diary, self._result = diary, Result()
        component, start = worker_class.component, diary.start
        if start.get("component") != component.name:
            raise ConfigurationError(
                f"{diary.path} is the diary of `{start.get('component')}`, not of `{component.name}`"
            )
        self._result.left_out = [str(each) for each in start.get("left_out", [])]
        self._spec = component.params
        with as_broken(diary.path, start):
            chosen = _settings(worker_class, start)
        self._worker = Running(worker_class, chosen, _no_transport).worker
        self._handlers = {
            name: (operation, coding.result_of(operation)) for name, operation in coding.handlers(component).items()
        }
        self._hooks = {*coding.hooks(component), *coding.WATCHING, coding.PARAMS}
        self._later: dict[int, Callable[[], object]] = {}
        self._turns: dict[int, _Turn] = {}
        self._threads: list[threading.Thread] = []
        self._spare, self._wanted = 0, threading.Semaphore(0)
        """Threads that wait to be needed again, and what they wait for."""
        self._turn: _Turn | None = None
        self._is_over, self._ended = False, threading.Event()
        self._failure: BaseException | None = None
        self._last = start
        """The event that is run."""
        self._prepare(chosen.instance, _number(start, "seed"))

    def run(self) -> Result:
        self._pass_on()
        event: Event | None = None
        while not self._ended.wait(LONGEST):
            if event is self._last:
                raise RobocompError(f"event {event['event']}: `{event.get('call', 'the call')}` does not end")
            event = self._last
        if self._failure:
            raise self._failure
        return self._result

    def close(self) -> None:
        """End the turns that still wait."""
        self._is_over = True
        for turn in self._turns.values():
            turn.go.release()
        self._wanted.release(len(self._threads) or 1)
        for thread in self._threads:
            thread.join(LONGEST)

    def _prepare(self, instance: str, seed: int) -> None:
        worker: Any = self._worker
        worker._seed = (seed, *instance.encode())
        vars(worker).update(
            now=lambda: self._read("now", worker._clock.now),
            _state=lambda: State(self._read("state", lambda: State.COMPUTE)),
            _sleep=self._sleep,
            _after=self._after,
            _signal=lambda event: None,
        )
        bound: dict[str, dict[str, Any]] = {}
        for port, operation, pattern, name in coding.outs(worker.component):
            kind = _Query if pattern is Pattern.QUERY else _Send
            bound.setdefault(port.attribute, {})[operation.name] = kind(self, name, operation)
        for port in worker.component.ports:
            if port.attribute in bound and port.proxy and not port.each:
                setattr(worker, port.attribute, port.proxy(bound[port.attribute]))

    # The turns.

    def _pass_on(self) -> None:
        """Let another thread go on with the diary."""
        if self._spare:
            self._spare -= 1
            self._wanted.release()
            return
        # A daemon, because code that never ends must not keep this process.
        thread = threading.Thread(target=self._thread, name=f"turns-{len(self._threads)}", daemon=True)
        if not start_thread(thread):
            raise RobocompError(NO_THREAD)
        self._threads.append(thread)

    def _thread(self) -> None:
        try:
            while self._go_on():
                self._wanted.acquire()
                if self._is_over:
                    return
        except BaseException as exc:  # raised by `run`
            self._failure = exc
        self._is_over = True
        self._ended.set()

    def _go_on(self) -> bool:
        """Run turns, until one goes on that has waited on another thread. False at the end."""
        while not self._is_over and (event := self._diary.peek()):
            match event["kind"]:
                case "turn":
                    self._begin(event)
                case "back" if (turn := self._turns.get(event["turn"])) and turn.is_waiting:
                    self._spare += 1
                    self._wake(turn, event)
                    return True
                case "left out":
                    self._result.left_out.append(str(event.get("what")))
                    self._diary.take()
                case _:
                    self._part(event, _told(event), _NOTHING)
        return False

    def _begin(self, event: Event) -> None:
        with as_broken(self._diary.path, event):
            method, operation, result = self._call_of(event)
        self._take(event)
        self._result.turns += 1
        turn = self._turns[event["turn"]] = self._turn = _Turn(event["turn"])
        here.read = self._read
        try:
            more: dict[str, Any] = {}
            try:
                value = method()
                more = {"data": result(value)} if result else {}
            except _Over:
                return
            except BaseException as exc:
                more = {"error": coding.error_of(exc)}
            if not self._is_over:
                self._end(turn, str(event["call"]), operation, more)
        except _Over:
            pass
        finally:
            here.read = None
            if not self._is_over:
                del self._turns[turn.number]
                self._turn = None

    def _wake(self, turn: _Turn, event: Event) -> None:
        self._take(event)
        turn.back, turn.is_waiting, self._turn = event, False, turn
        turn.go.release()

    def _take(self, event: Event) -> None:
        self._diary.take()
        self._last = event

    def _call_of(self, event: Event) -> tuple[Callable[[], Any], Operation[Any] | None, _Encode | None]:
        """What a turn calls, and what makes octets of what that returns. Raises ValueError, TypeError, LookupError."""
        name = str(event["call"])
        if name.startswith("after "):
            return self._later[int(name.removeprefix("after "))], None, None
        if found := self._handlers.get(name):
            operation, result = found
            arguments = coding.decoded(operation.request, event.get("data"))
            return partial(getattr(self._worker, name), *arguments), operation, result
        if name not in self._hooks:
            raise LookupError(f"this component has no method `{name}`")
        values = list(event.get("values", []))
        if name == coding.PARAMS:
            if self._spec:
                self._worker._configured = build(self._spec, event["params"])
            values = [frozenset(values[0])]
        return partial(getattr(self._worker, name), *values), None, None

    def _end(self, turn: _Turn, call: str, operation: Operation[Any] | None, more: dict[str, Any]) -> None:
        event = self._expect("end", turn, f"the end of {call}{_failure(more)}")
        was, now = event.get("error"), more.get("error")
        self._result.outputs += bool(was or now or (operation and operation.outputs))  # exceptions go out, too
        if _short(was) != _short(now):
            self._note(event, f"{call} {_outcomes(was, now)}")
        elif operation and not now and event.get("data") != more.get("data"):
            with as_broken(self._diary.path, event):
                what = _compared(operation.outputs, operation, event.get("data"), more.get("data"), response=True)
            self._note(event, f"{call}{what}")

    # What the code does.

    def out(self, name: str, operation: Operation[Any], data: bytes | None) -> Event:
        """Something goes out. Returns its event."""
        turn = self._here()
        event = self._expect("out", turn, name)
        self._result.outputs += 1
        if event.get("data") != data:
            with as_broken(self._diary.path, event):
                what = _compared(operation.inputs, operation, event.get("data"), data)
            self._note(event, f"{name}{what}")
        return event

    def wait(self, turn: _Turn) -> Event:
        """Let others run, until the diary says that the wait is over."""
        event = self._diary.peek()
        if event and event["kind"] == "back" and event["turn"] == turn.number:
            self._take(event)  # nothing has run meanwhile
            return event
        turn.is_waiting = True
        before, here.read = here.read, None
        self._pass_on()
        turn.go.acquire()
        if self._is_over:
            raise _Over
        here.read = before
        assert turn.back is not None
        return turn.back

    def _here(self) -> _Turn:
        turn = self._turn
        if self._is_over or turn is None or turn.thread is not threading.current_thread():
            raise _Over  # a thread that the component has started: see `left_out`
        return turn

    def _sleep(self, seconds: float) -> bool:
        turn = self._here()
        self._expect("wait", turn, "sleep")
        return bool(self.wait(turn).get("value"))

    def _after(self, seconds: float, function: Callable[[], object]) -> Any:
        event = self._expect("after", self._here(), "after")
        with as_broken(self._diary.path, event):
            self._later[int(event["number"])] = function
        if event.get("value") != seconds:
            self._differ(event, "the time of after()", f"{event.get('value')} s", f"{seconds} s")
        return _Later()

    def _read(self, what: str, original: Callable[[], Any]) -> Any:
        turn = self._turn
        if self._is_over or turn is None or turn.thread is not threading.current_thread():
            return original()
        return self._expect("read", turn, what).get("value")

    # Comparing.

    def _expect(self, kind: str, turn: _Turn, name: str) -> Event:
        """The next event, which is to be of this kind and turn. Otherwise the code does something else than before."""
        event = self._diary.peek()
        while event and event["kind"] == "left out":
            self._result.left_out.append(str(event.get("what")))
            self._diary.take()
            event = self._diary.peek()
        if event is None:
            self._is_over = True
            raise _Over  # the diary ends here, in the middle of a turn
        is_same = event["kind"] == kind and event["turn"] == turn.number
        if is_same and (kind not in ("out", "read", "wait") or name == event.get("call", event.get("what"))):
            self._take(event)
            self._result.seconds = event["ns"] / 1e9
            return event
        self._part(event, _told(event), name)
        raise _Over

    def _part(self, event: Event, was: str, now: str) -> None:
        self._result.outputs += 1
        self._note(event, f"{was} came next, now it is {now}")
        self._result.is_parted = self._is_over = True

    def _differ(self, event: Event, what: str, was: object, now: object) -> None:
        self._note(event, f"{what} was {was}, is {now}")

    def _note(self, event: Event, text: str) -> None:
        self._result.differences.append(Difference(event["event"], event["ns"] / 1e9, text))


class _Later:
    """What `after` returns."""

    def cancel(self) -> None: ...


class _Out:
    def __init__(self, again: _Again, name: str, operation: Operation[Any]) -> None:
        self._again, self._name, self._operation = again, name, operation
        self._request = coding.request_of(operation)


class _Send(_Out):
    @property
    def loans(self) -> Any:
        from ...runtime.loans import Loans  # few components fill messages in place

        outlet: Any = object()  # of a transport that lends no memory
        return Loans(Call(self._operation, Cdr()), outlet)

    def send(self, arguments: tuple[Any, ...], deadline: float | None = None, memory: Any = None) -> None:
        event = self._again.out(self._name, self._operation, self._request(arguments))
        if event.get("error"):
            raise coding.exception_of(event["error"], self._operation)


class _Query(_Out):
    def ask(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        turn = self._again._here()
        self._again.out(self._name, self._operation, self._request(arguments))
        event = self._again.wait(turn)
        with as_broken(self._again._diary.path, event):
            if event.get("error"):
                failed = coding.exception_of(event["error"], self._operation)
            else:
                return coding.value_of(self._operation, event["data"])
        raise failed

    def ask_async(self, arguments: tuple[Any, ...], deadline: float | None) -> Any:
        raise RobocompError(f"{self._name} is called asynchronously, which cannot be run again")


def _settings(worker_class: type[Worker[Any]], start: Event) -> settings.Settings:
    document = settings.Document(dict(start["configuration"]), params=worker_class.component.params)
    own = document.data.get("component")
    if isinstance(own, dict):
        document.data["component"] = {key: value for key, value in own.items() if key != "diary"}
    document.data.pop("clock", None)
    return settings.check(worker_class.component, document, str(start["instance"]))


def _no_transport(name: str) -> TransportFactory:
    raise AssertionError("nothing is sent while a component runs again")


def _told(event: Event) -> str:
    """An event, for people."""
    match event["kind"]:
        case "out" | "turn":
            return str(event.get("call"))
        case "read" | "wait":
            return str(event.get("what", "a wait"))
        case "back":
            return "the end of a wait"
        case "end":
            return f"the end of the call{_failure(event)}"
        case kind:
            return str(kind)


def _failure(ended: Mapping[str, Any]) -> str:
    """How a call has failed, if it has."""
    error = ended.get("error")
    return f", which fails with {error.get('kind')}: {error.get('text')}" if error else ""


def _short(error: dict[str, Any] | None) -> tuple[Any, ...] | None:
    return (error.get("kind"), error.get("text"), error.get("data")) if error else None


def _outcomes(was: dict[str, Any] | None, now: dict[str, Any] | None) -> str:
    """How a call ended before, and how it ends now, if one of both is an error."""
    before, after = (f"{each.get('kind')}: {each.get('text')}" if each else "" for each in (was, now))
    if not before:
        return f"did not fail, now it fails with {after}"
    return f"failed with {before}, now " + (f"with {after}" if after else "it does not fail")


def _compared(fields: Any, operation: Operation[Any], was: Any, now: Any, *, response: bool = False) -> str:
    """The first field that differs: `.rot was 0.3, is 0.4`. Raises ValueError."""
    message = operation.response if response else operation.request
    before, after = (None if each is None else coding.decoded(message, each) for each in (was, now))
    if before is None or after is None:
        return " did not fit its contract, now it does" if before is None else " fitted its contract, now it does not"
    return _first(tuple(fields), before, after)


def _first(fields: tuple[Field, ...], before: tuple[Any, ...], after: tuple[Any, ...]) -> str:
    found = _difference("", json.show_fields(fields, before), json.show_fields(fields, after))
    return found or " differs in octets alone"


def _difference(path: str, was: Any, now: Any) -> str:
    """The first difference of two values of JSON; "" if they are equal."""
    if isinstance(was, dict) and isinstance(now, dict) and was.keys() == now.keys():
        return next(filter(None, (_difference(f"{path}.{key}", was[key], now[key]) for key in was)), "")
    if isinstance(was, list) and isinstance(now, list):
        if len(was) != len(now):
            return f"{path} had {len(was)} items, has {len(now)}"
        pairs = enumerate(zip(was, now, strict=True))
        return next(filter(None, (_difference(f"{path}[{at}]", *pair) for at, pair in pairs)), "")
    return "" if was == now else f"{path} was {was}, is {now}"
