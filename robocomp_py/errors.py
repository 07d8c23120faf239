"""Everything that can go wrong, in one tree.

    RobocompError
      DslError                 text of a DSL file is wrong; carries diagnostics
      ConfigurationError       a setting is wrong; says which, where, and what would be right
      ComponentError           a component's specific part does not fit its generic part, or failed
      DeploymentError          a network cannot be started, or did not stay up
        HostUnreachable        a host it needs cannot be reached, or cannot run what it should
      ArgumentError            a call has arguments that its handler cannot use
      CodecError               a value and its type, or bytes and their type, do not match
        EncodeError            ... when sending
        DecodeError            ... when receiving
      TransportError           the way to the other side
        Unreachable            no server serves this channel, or its server is stopping
        Timeout                no reply within the deadline (a `TimeoutError`, too)
        Closed                 the link or its transport was closed
        ContractMismatch       both sides use the name, but mean different things by it
        UnsupportedQoS         asked for what this transport does not offer
        AlreadyServed          another process serves this channel
        Busy                   the other side has too much to do to take this call
        Refused                our keys do not allow it, or a foreign program has no such operation
      Cancelled                a goal of an action was cancelled
      DeclaredError            base of the exceptions that an IDSL operation `throws`
      RemoteFailure            the other side raised something it had not declared

A call through a proxy raises `TransportError`, `RemoteFailure`, the exceptions its operation
declares, and `EncodeError` for arguments that do not fit: the same ones on every middleware.
"""

from __future__ import annotations


class RobocompError(Exception):
    """Base of all errors raised by this package on purpose."""


class ConfigurationError(RobocompError):
    """A setting is wrong. The message names the key, where it stands, and what is allowed."""


class ComponentError(RobocompError):
    """A component cannot run as it is written; the message says what to change."""


class DeploymentError(RobocompError):
    """A network cannot be started, or a part of it failed."""


class HostUnreachable(DeploymentError):
    """A host cannot be reached, or cannot run what it should; the message says which, why, and what to try."""


class ArgumentError(RobocompError, ValueError):
    """A handler raises this for arguments that it cannot use, if its operation declares no exception for them.

    The caller gets RemoteFailure with the text, and the log of the component has one line without a traceback.
    """


class CodecError(RobocompError):
    """A value or some bytes do not match the type of a message."""


class EncodeError(CodecError, ValueError):
    """A value does not fit its type; the message names the field."""


class DecodeError(CodecError, ValueError):
    """Received bytes do not hold a message of the expected type."""


class TransportError(RobocompError):
    """Something between the two sides went wrong; base of the outcomes every transport shares."""


class Unreachable(TransportError):
    """This channel has no server now, or its server is stopping."""


class Timeout(TransportError, TimeoutError):
    """No answer before the deadline. Whether the operation was executed is not known."""


class Closed(TransportError):
    """The link was closed, by us, while in use or before."""


class ContractMismatch(TransportError):
    """The other side was generated from a different definition of this operation."""


class UnsupportedQoS(TransportError):
    """This transport cannot keep what was asked of the channel."""


class AlreadyServed(TransportError):
    """There can be one server of a channel, and there is one; the message says whose it is."""

    @classmethod
    def by(cls, channel: str, server: str) -> AlreadyServed:
        """The error for a channel that this process serves, as `world (pid 1234)`."""
        return cls(f"{channel}: already served by {server}; end that one, or give one of the networks a namespace")


class Busy(TransportError):
    """The other side has too many calls waiting; it did not execute this one."""


class Refused(TransportError):
    """The keys of this process do not allow the call, or a foreign program does not serve it. It was not executed."""


class Cancelled(RobocompError):
    """A goal was cancelled. The `yield` of its handler raises this, and so does `result` of the client."""


class DeclaredError(RobocompError):
    """Base of the exceptions declared in IDSL; generated subclasses carry their fields."""

    def __str__(self) -> str:
        named = [name for name in getattr(self, "__dataclass_fields__", ()) if name != "__contract__"]
        values = {name: getattr(self, name) for name in named}
        if len(values) == 1:
            return str(*values.values())
        return ", ".join(f"{name}={value!r}" for name, value in values.items())


class RemoteFailure(RobocompError):
    """A handler on the other side raised an exception that its interface does not declare.

    `kind` is the name of its class there, `reason` its text, `trace` the remote traceback.
    """

    def __init__(self, operation: str, kind: str, reason: str, trace: str = "") -> None:
        super().__init__(f"{operation} failed on the other side: {kind}: {reason}")
        self.operation, self.kind, self.reason, self.trace = operation, kind, reason, trace
