# Generated from Introspection.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, UP040, RUF100
"""Module RoboCompIntrospection: types, interfaces and proxies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from robocomp_py.runtime.api import (
    BOOL,
    FLOAT32,
    FLOAT64,
    INT32,
    INT64,
    STRING,
    TIME,
    UINT8,
    Field,
    Interface,
    Operation,
    Pattern,
    Sequence,
    Struct,
)


@dataclass(slots=True)
class Comment:
    """A comment of an IDSL file."""

    # empty for the operation; else a parameter, a struct, or a field as `TBaseState.x`
    about: str = ""
    text: str = ""  # in lines

    __contract__: ClassVar[Struct]


Comment.__contract__ = Struct(
    "RoboCompIntrospection::Comment",
    (
        Field(
            "about",
            STRING,
            doc="empty for the operation; else a parameter, a struct, or a field as `TBaseState.x`",  # noqa: E501, RUF100
        ),
        Field("text", STRING, doc="in lines"),
    ),
    Comment,
    doc="A comment of an IDSL file.",
)

CommentList: TypeAlias = list[Comment]

TextList: TypeAlias = list[str]

Durations: TypeAlias = NDArray[np.float32]


@dataclass(slots=True)
class End:
    """One operation of a port over one middleware."""

    port: str = ""  # as the CDSL has it; of a named instance, `front/Laser`
    verb: str = ""  # requires, implements, publishes or subscribesTo
    operation: str = ""
    channel: str = ""  # its whole name; for any instance, with `*`
    middleware: str = ""
    pattern: str = ""  # query, command or publish
    definition: str = ""  # all that both sides must agree on, in lines
    qos: str = ""  # as in a configuration; empty for calls
    deadline: float = 0.0  # of a call, in s
    idempotent: bool = False
    confirm: bool = False  # whether a person is asked before it is called by hand
    comments: CommentList = field(default_factory=list)

    __contract__: ClassVar[Struct]


End.__contract__ = Struct(
    "RoboCompIntrospection::End",
    (
        Field(
            "port",
            STRING,
            doc="as the CDSL has it; of a named instance, `front/Laser`",
        ),
        Field("verb", STRING, doc="requires, implements, publishes or subscribesTo"),
        Field("operation", STRING),
        Field("channel", STRING, doc="its whole name; for any instance, with `*`"),
        Field("middleware", STRING),
        Field("pattern", STRING, doc="query, command or publish"),
        Field("definition", STRING, doc="all that both sides must agree on, in lines"),
        Field("qos", STRING, doc="as in a configuration; empty for calls"),
        Field("deadline", FLOAT64, doc="of a call, in s"),
        Field("idempotent", BOOL),
        Field(
            "confirm",
            BOOL,
            doc="whether a person is asked before it is called by hand",
        ),
        Field("comments", Sequence(Comment.__contract__)),
    ),
    End,
    doc="One operation of a port over one middleware.",
)

EndList: TypeAlias = list[End]


@dataclass(slots=True)
class Setting:
    """A parameter of the component."""

    name: str = ""  # `max_speed`, or `motors[0].max_speed`
    type: str = ""  # int, float, string, bool or enum
    value: str = ""
    initial: str = ""  # the value if none is given
    minimum: str = ""  # empty if there is none
    maximum: str = ""  # empty if there is none
    choices: TextList = field(default_factory=list)
    comment: str = ""
    editable: bool = False  # whether it can be changed while the component runs

    __contract__: ClassVar[Struct]


Setting.__contract__ = Struct(
    "RoboCompIntrospection::Setting",
    (
        Field("name", STRING, doc="`max_speed`, or `motors[0].max_speed`"),
        Field("type", STRING, doc="int, float, string, bool or enum"),
        Field("value", STRING),
        Field("initial", STRING, doc="the value if none is given"),
        Field("minimum", STRING, doc="empty if there is none"),
        Field("maximum", STRING, doc="empty if there is none"),
        Field("choices", Sequence(STRING)),
        Field("comment", STRING),
        Field(
            "editable",
            BOOL,
            doc="whether it can be changed while the component runs",
        ),
    ),
    Setting,
    doc="A parameter of the component.",
)

SettingList: TypeAlias = list[Setting]


@dataclass(slots=True)
class Description:
    """What a component is."""

    instance: str = ""  # its whole name, as `robot1/world`
    component: str = ""
    host: str = ""
    pid: int = 0
    version: str = ""  # of robocomp_py
    started: int = 0
    # empty for the machine's; else the instance whose clock it follows, or `virtual`
    clock: str = ""
    ends: EndList = field(default_factory=list)
    settings: SettingList = field(default_factory=list)

    __contract__: ClassVar[Struct]


Description.__contract__ = Struct(
    "RoboCompIntrospection::Description",
    (
        Field("instance", STRING, doc="its whole name, as `robot1/world`"),
        Field("component", STRING),
        Field("host", STRING),
        Field("pid", INT32),
        Field("version", STRING, doc="of robocomp_py"),
        Field("started", TIME),
        Field(
            "clock",
            STRING,
            doc="empty for the machine's; else the instance whose clock it follows, or `virtual`",  # noqa: E501, RUF100
        ),
        Field("ends", Sequence(End.__contract__)),
        Field("settings", Sequence(Setting.__contract__)),
    ),
    Description,
    doc="What a component is.",
)


@dataclass(slots=True)
class Measure:
    """What was counted of one operation over one middleware since the start."""

    port: str = ""
    verb: str = ""
    operation: str = ""
    channel: str = ""
    middleware: str = ""
    count: int = 0  # messages or calls, those that failed included
    failed: int = 0  # of these; an exception that the IDSL declares is an answer
    # of these, how many were timed: each, or every 64th while they are frequent
    timed: int = 0
    # of the latest 256 timed, oldest first, in s: a caller's round trip, a handler's
    # run, or a send
    latest: Durations = field(default_factory=lambda: np.empty(0, np.float32))
    # of the same for a handler: how long each waited until it ran, in s
    waited: Durations = field(default_factory=lambda: np.empty(0, np.float32))
    received: int = 0  # What the link has received, and what was not delivered.
    malformed: int = 0  # no valid message
    mismatched: int = 0  # of another contract
    expired: int = 0  # too late
    repeated: int = 0  # not executed again
    lost: int = 0  # missing in the sequence of a sender
    dropped: int = 0  # a queue was full

    __contract__: ClassVar[Struct]


Measure.__contract__ = Struct(
    "RoboCompIntrospection::Measure",
    (
        Field("port", STRING),
        Field("verb", STRING),
        Field("operation", STRING),
        Field("channel", STRING),
        Field("middleware", STRING),
        Field("count", INT64, doc="messages or calls, those that failed included"),
        Field(
            "failed",
            INT64,
            doc="of these; an exception that the IDSL declares is an answer",
        ),
        Field(
            "timed",
            INT64,
            doc="of these, how many were timed: each, or every 64th while they are frequent",  # noqa: E501, RUF100
        ),
        Field(
            "latest",
            Sequence(FLOAT32),
            doc="of the latest 256 timed, oldest first, in s: a caller's round trip, a handler's run, or a send",  # noqa: E501, RUF100
        ),
        Field(
            "waited",
            Sequence(FLOAT32),
            doc="of the same for a handler: how long each waited until it ran, in s",
        ),
        Field(
            "received",
            INT64,
            doc="What the link has received, and what was not delivered.",
        ),
        Field("malformed", INT64, doc="no valid message"),
        Field("mismatched", INT64, doc="of another contract"),
        Field("expired", INT64, doc="too late"),
        Field("repeated", INT64, doc="not executed again"),
        Field("lost", INT64, doc="missing in the sequence of a sender"),
        Field("dropped", INT64, doc="a queue was full"),
    ),
    Measure,
    doc="What was counted of one operation over one middleware since the start.",
)

MeasureList: TypeAlias = list[Measure]


@dataclass(slots=True)
class Measures:
    """What was counted since the start. Rates follow from two of them."""

    at: int = 0
    awake: float = 0.0  # in s, by a clock that never jumps
    state: str = ""
    period: float = 0.0  # of compute, in s
    computes: int = 0
    overruns: int = 0  # periods that were left out, of compute and all timers
    queued: int = 0  # requests and threads that wait to run its code
    suspended: int = 0  # handlers that wait for an answer
    revision: int = 0  # how often its parameters have changed
    processor: float = 0.0  # of its whole process, in s
    memory: int = 0  # of its whole process, resident, in octets; 0 if unknown
    operations: MeasureList = field(default_factory=list)

    __contract__: ClassVar[Struct]


Measures.__contract__ = Struct(
    "RoboCompIntrospection::Measures",
    (
        Field("at", TIME),
        Field("awake", FLOAT64, doc="in s, by a clock that never jumps"),
        Field("state", STRING),
        Field("period", FLOAT64, doc="of compute, in s"),
        Field("computes", INT64),
        Field(
            "overruns",
            INT64,
            doc="periods that were left out, of compute and all timers",
        ),
        Field("queued", INT32, doc="requests and threads that wait to run its code"),
        Field("suspended", INT32, doc="handlers that wait for an answer"),
        Field("revision", INT64, doc="how often its parameters have changed"),
        Field("processor", FLOAT64, doc="of its whole process, in s"),
        Field(
            "memory",
            INT64,
            doc="of its whole process, resident, in octets; 0 if unknown",
        ),
        Field("operations", Sequence(Measure.__contract__)),
    ),
    Measures,
    doc="What was counted since the start. Rates follow from two of them.",
)

Octets: TypeAlias = NDArray[np.uint8]


@dataclass(slots=True)
class Call:
    """A query or a command that has ended."""

    # the whole name of the component that called; empty if the server tells of it
    caller: str = ""
    channel: str = ""  # as its side names it; for any instance, with `*`
    middleware: str = ""
    begun: int = 0
    # a caller's round trip, a handler's wait and run, or the sending of a command, in s
    took: float = 0.0
    # ok, thrown, failed, timeout, unreachable, busy, mismatch, refused, closed or
    # cancelled
    status: str = ""
    # what went wrong, as text; empty if nothing did, or if the other side knows it only
    error: str = ""
    request: Octets = field(default_factory=lambda: np.empty(0, np.uint8))  # as CDR
    # as CDR; empty unless the status is ok
    response: Octets = field(default_factory=lambda: np.empty(0, np.uint8))
    dropped: int = 0  # calls before it that are not told, because they came too fast

    __contract__: ClassVar[Struct]


Call.__contract__ = Struct(
    "RoboCompIntrospection::Call",
    (
        Field(
            "caller",
            STRING,
            doc="the whole name of the component that called; empty if the server tells of it",  # noqa: E501, RUF100
        ),
        Field(
            "channel",
            STRING,
            doc="as its side names it; for any instance, with `*`",
        ),
        Field("middleware", STRING),
        Field("begun", TIME),
        Field(
            "took",
            FLOAT64,
            doc="a caller's round trip, a handler's wait and run, or the sending of a command, in s",  # noqa: E501, RUF100
        ),
        Field(
            "status",
            STRING,
            doc="ok, thrown, failed, timeout, unreachable, busy, mismatch, refused, closed or cancelled",  # noqa: E501, RUF100
        ),
        Field(
            "error",
            STRING,
            doc="what went wrong, as text; empty if nothing did, or if the other side knows it only",  # noqa: E501, RUF100
        ),
        Field("request", Sequence(UINT8), doc="as CDR"),
        Field("response", Sequence(UINT8), doc="as CDR; empty unless the status is ok"),
        Field(
            "dropped",
            INT64,
            doc="calls before it that are not told, because they came too fast",
        ),
    ),
    Call,
    doc="A query or a command that has ended.",
)


@dataclass(slots=True)
class Record:
    """What a component has logged."""

    at: int = 0
    level: str = ""  # DEBUG, INFO, WARNING, ERROR or CRITICAL
    logger: str = ""
    # the component that logged it; of a shared process it may be empty
    instance: str = ""
    thread: str = ""
    file: str = ""
    line: int = 0
    text: str = ""  # in lines; cut if it is long
    trace: str = ""  # the id of the trace that it belongs to; empty if it has none
    dropped: int = 0  # records before it that are not told, because they came too fast

    __contract__: ClassVar[Struct]


Record.__contract__ = Struct(
    "RoboCompIntrospection::Record",
    (
        Field("at", TIME),
        Field("level", STRING, doc="DEBUG, INFO, WARNING, ERROR or CRITICAL"),
        Field("logger", STRING),
        Field(
            "instance",
            STRING,
            doc="the component that logged it; of a shared process it may be empty",
        ),
        Field("thread", STRING),
        Field("file", STRING),
        Field("line", INT32),
        Field("text", STRING, doc="in lines; cut if it is long"),
        Field(
            "trace",
            STRING,
            doc="the id of the trace that it belongs to; empty if it has none",
        ),
        Field(
            "dropped",
            INT64,
            doc="records before it that are not told, because they came too fast",
        ),
    ),
    Record,
    doc="What a component has logged.",
)

_Introspection_describe: Operation[Description] = Operation(
    "RoboCompIntrospection::Introspection",
    "describe",
    outputs=(Field("ret", Description.__contract__),),
    idempotent=True,
    doc="What the component is.",
)
_Introspection_measure: Operation[Measures] = Operation(
    "RoboCompIntrospection::Introspection",
    "measure",
    outputs=(Field("ret", Measures.__contract__),),
    idempotent=True,
    doc="What it has counted.",
)
_Introspection_setLogLevel: Operation[None] = Operation(
    "RoboCompIntrospection::Introspection",
    "setLogLevel",
    inputs=(
        Field("logger", STRING),
        Field("level", STRING),
    ),
    doc="Log at another level (debug, info, warning or error) until the component ends. An empty name means all loggers.",  # noqa: E501, RUF100
)
_Introspection_watch: Operation[None] = Operation(
    "RoboCompIntrospection::Introspection",
    "watch",
    inputs=(
        Field("calls", BOOL),
        Field("logs", BOOL),
        Field("lease", FLOAT32),
    ),
    idempotent=True,
    doc="Publish calls, log records, or both, for this number of seconds (at most 60) from now. Longer leases of others\nstay as they are. The topics of IntrospectionPub exist only meanwhile.",  # noqa: E501, RUF100
)
INTROSPECTION_INTERFACE = Interface(
    "RoboCompIntrospection::Introspection",
    (
        _Introspection_describe,
        _Introspection_measure,
        _Introspection_setLogLevel,
        _Introspection_watch,
    ),
)

_IntrospectionPub_called: Operation[None] = Operation(
    "RoboCompIntrospection::IntrospectionPub",
    "called",
    inputs=(Field("call", Call.__contract__),),
    pattern=Pattern.PUBLISH,
    doc="Each query and command that the component has called or served.",
)
_IntrospectionPub_logged: Operation[None] = Operation(
    "RoboCompIntrospection::IntrospectionPub",
    "logged",
    inputs=(Field("entry", Record.__contract__),),
    pattern=Pattern.PUBLISH,
    doc="Each record that it has logged.",
)
INTROSPECTIONPUB_INTERFACE = Interface(
    "RoboCompIntrospection::IntrospectionPub",
    (
        _IntrospectionPub_called,
        _IntrospectionPub_logged,
    ),
)
