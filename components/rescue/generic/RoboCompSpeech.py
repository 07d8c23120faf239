# Generated from Speech.idsl by rcgen 0.1.0: edits are lost.
"""Module RoboCompSpeech: what travels, and how to send it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    BOOL,
    STRING,
    Field,
    Future,
    Interface,
    Operation,
    Pattern,
    Proxy,
    Struct,
)


@dataclass(slots=True)
class datasayin:
    """Something to say."""

    text: str = ""
    overwrite: bool = False  # whether to break off what is being said

    __contract__: ClassVar[Struct]


datasayin.__contract__ = Struct(
    "RoboCompSpeech::datasayin",
    (
        Field("text", STRING),
        Field("overwrite", BOOL),
    ),
    datasayin,
)


@dataclass(slots=True)
class dataresponse:
    """What came of a request."""

    ok: bool = False  # whether the request was taken
    busy: bool = False  # whether something is being said now
    text: str = ""  # what is being said now, or ""

    __contract__: ClassVar[Struct]


dataresponse.__contract__ = Struct(
    "RoboCompSpeech::dataresponse",
    (
        Field("ok", BOOL),
        Field("busy", BOOL),
        Field("text", STRING),
    ),
    dataresponse,
)


@dataclass(slots=True)
class dataenableSynchronization:
    """Whether speech and other output, such as a moving mouth, go together."""

    enable: bool = False  # true: word by word, false: the whole text at once

    __contract__: ClassVar[Struct]


dataenableSynchronization.__contract__ = Struct(
    "RoboCompSpeech::dataenableSynchronization",
    (Field("enable", BOOL),),
    dataenableSynchronization,
)

_Speech_say: Operation[dataresponse] = Operation(
    "RoboCompSpeech::Speech",
    "say",
    inputs=(Field("pin", datasayin.__contract__),),
    outputs=(Field("pout", dataresponse.__contract__),),
    pattern=Pattern.QUERY,
)
_Speech_isBusy: Operation[dataresponse] = Operation(
    "RoboCompSpeech::Speech",
    "isBusy",
    outputs=(Field("pout", dataresponse.__contract__),),
    pattern=Pattern.QUERY,
)
_Speech_enableSynchronization: Operation[None] = Operation(
    "RoboCompSpeech::Speech",
    "enableSynchronization",
    inputs=(Field("pin", dataenableSynchronization.__contract__),),
    pattern=Pattern.COMMAND,
)
_Speech_stop: Operation[None] = Operation(
    "RoboCompSpeech::Speech",
    "stop",
    pattern=Pattern.COMMAND,
)
SPEECH_INTERFACE = Interface(
    "RoboCompSpeech::Speech",
    (
        _Speech_say,
        _Speech_isBusy,
        _Speech_enableSynchronization,
        _Speech_stop,
    ),
)


class SpeechProxy(Proxy):
    """Calls Speech of another component.

    Deadlines are in seconds. Raises what the operation declares, RemoteFailure for
    other exceptions over there, and TransportErrors: Unreachable, Timeout, Busy,
    ContractMismatch, Refused, Closed.
    """

    interface = SPEECH_INTERFACE

    def say(self, pin: datasayin, *, deadline: float | None = None) -> dataresponse:
        """Begin to say something; not `ok` if something else is being said and may not
        be broken off.

        IDSL: [query] void say(datasayin pin, out dataresponse pout)
        """
        return self._ask(_Speech_say, (pin,), deadline)

    def sayAsync(
        self,
        pin: datasayin,
        *,
        deadline: float | None = None,
    ) -> Future[dataresponse]:
        """`say` without waiting: a Future that ends within the deadline."""
        return self._ask_async(_Speech_say, (pin,), deadline)

    def isBusy(self, *, deadline: float | None = None) -> dataresponse:
        """Whether something is being said.

        IDSL: [query] void isBusy(out dataresponse pout)
        """
        return self._ask(_Speech_isBusy, (), deadline)

    def isBusyAsync(self, *, deadline: float | None = None) -> Future[dataresponse]:
        """`isBusy` without waiting: a Future that ends within the deadline."""
        return self._ask_async(_Speech_isBusy, (), deadline)

    def enableSynchronization(
        self,
        pin: dataenableSynchronization,
        *,
        deadline: float | None = None,
    ) -> None:
        """Show words as they are said, or the whole text when it begins.

        IDSL: [command] void enableSynchronization(dataenableSynchronization pin)
        """
        self._send(_Speech_enableSynchronization, (pin,), deadline)

    def stop(self, *, deadline: float | None = None) -> None:
        """Be silent at once.

        IDSL: [command] void stop()
        """
        self._send(_Speech_stop, (), deadline)
