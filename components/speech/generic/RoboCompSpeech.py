# Generated from Speech.idsl by rcgen 0.1.0: edits are lost.
# ruff: noqa: N999, RUF100
"""Module RoboCompSpeech: types, interfaces and proxies."""

from __future__ import annotations

from robocomp_py.runtime.api import BOOL, STRING, Field, Interface, Operation

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
