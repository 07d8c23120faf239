# Generated from Speech.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompSpeech: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import (
    BOOL,
    STRING,
    Field,
    Future,
    Interface,
    Operation,
    Proxy,
)

_Speech_say: Operation[bool] = Operation(
    "RoboCompSpeech::Speech",
    "say",
    inputs=(
        Field("text", STRING),
        Field("overwrite", BOOL),
    ),
    outputs=(Field("ret", BOOL),),
    doc="Say something: whether it was accepted. With `overwrite`, it replaces what is being said.",  # noqa: E501, RUF100
)
_Speech_isBusy: Operation[bool] = Operation(
    "RoboCompSpeech::Speech",
    "isBusy",
    outputs=(Field("ret", BOOL),),
    doc="Whether something is being said.",
)
SPEECH_INTERFACE = Interface(
    "RoboCompSpeech::Speech",
    (
        _Speech_say,
        _Speech_isBusy,
    ),
)


class SpeechProxy(Proxy):
    """Calls Speech of another component.

    Deadlines are in seconds. A call raises the exceptions that the operation declares,
    RemoteFailure for any other exception of the server, and TransportErrors:
    Unreachable, Timeout, Busy, ContractMismatch, Refused, Closed.
    """

    interface = SPEECH_INTERFACE

    def say(self, text: str, overwrite: bool, *, deadline: float | None = None) -> bool:
        """Say something: whether it was accepted. With `overwrite`, it replaces what is
        being said.

        IDSL: bool say(string text, bool overwrite)
        """
        return self._ask(_Speech_say, (text, overwrite), deadline)

    def sayAsync(
        self,
        text: str,
        overwrite: bool,
        *,
        deadline: float | None = None,
    ) -> Future[bool]:
        """Call `say` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Speech_say, (text, overwrite), deadline)

    def isBusy(self, *, deadline: float | None = None) -> bool:
        """Whether something is being said.

        IDSL: bool isBusy()
        """
        return self._ask(_Speech_isBusy, (), deadline)

    def isBusyAsync(self, *, deadline: float | None = None) -> Future[bool]:
        """Call `isBusy` without waiting. The Future is done within the deadline."""
        return self._ask_async(_Speech_isBusy, (), deadline)
