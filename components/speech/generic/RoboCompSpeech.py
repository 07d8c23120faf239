# Generated from Speech.idsl by rcgen 0.1.0: edits are lost.
"""Module RoboCompSpeech: what travels, and how to send it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robocomp_py.runtime.api import (
    BOOL,
    STRING,
    Field,
    Interface,
    Operation,
    Pattern,
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
