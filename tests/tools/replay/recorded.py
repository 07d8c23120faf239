"""Recordings to replay, and what rc replay prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli import rc
from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.testing import everything as e
from robocomp_py.tools.recording.bag import BagWriter
from robocomp_py.tools.recording.layout import Topic
from robocomp_py.wire.cdr import Cdr

from ...runtime.components import RELIABLE

NEWS: Operation[Any] = e.news
POKE: Operation[Any] = e.poke
CHANNEL = "talker/Everything/news"


def recorded(folder: Path, numbers: int = 20, seconds: float = 0.01, channel: str = CHANNEL) -> Path:
    """A recording of `numbers` messages of `news`, some `seconds` apart, and of as many commands of `poke`."""
    writer = BagWriter(folder)
    news = writer.add(Topic(channel, NEWS, "talker", "shm", RELIABLE))
    poke = writer.add(Topic("poked/Everything/poke", POKE, "talker", "shm", pattern=Pattern.COMMAND))
    for number in range(numbers):
        at = 10**18 + int(number * seconds * 1e9)
        writer.write(news, bytes(Cdr().encoder(NEWS.request)((number, "again"))), at, at, number + 1)
        writer.write(poke, bytes(Cdr().encoder(POKE.request)((number,))), at, at, number + 1)
    writer.close()
    return folder


def said(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 0) -> str:
    assert rc.main(["replay", *map(str, arguments)]) == code, capsys.readouterr()
    return capsys.readouterr().out


def complained(capsys: pytest.CaptureFixture[str], *arguments: object, code: int = 1) -> str:
    assert rc.main(["replay", *map(str, arguments)]) == code, capsys.readouterr()
    return capsys.readouterr().err
