"""What commands of rc print, and over which middlewares components report themselves."""

from __future__ import annotations

import pytest

from robocomp_py.cli import rc
from robocomp_py.testing.patience import SOON

from ..runtime.components import MIDDLEWARES

TELLERS = [name for name in MIDDLEWARES if name != "inproc"]


def said(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> str:
    """What a command prints on its standard output."""
    assert rc.main([str(each) for each in arguments]) == code, capsys.readouterr()
    return capsys.readouterr().out


def complained(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 1) -> str:
    """What a command says on its standard error."""
    assert rc.main([str(each) for each in arguments]) == code, capsys.readouterr()
    return capsys.readouterr().err


def heard(capsys: pytest.CaptureFixture[str], *arguments: str, seconds: float) -> str:
    """What a command says that listens for a while. In a short time, a busy machine may hear nothing."""
    while rc.main([*arguments, "--for", f"{seconds:g}"]):
        assert seconds < SOON * 3, capsys.readouterr()
        seconds *= 4
        capsys.readouterr()
    return capsys.readouterr().out
