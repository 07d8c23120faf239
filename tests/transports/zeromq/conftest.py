"""Hosts and their keys, for tests over TCP."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from ...deploy.security_network import made
from .hosts import GRAPH, Hosts


@pytest.fixture(scope="module")
def all_keys() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="rc-keys-", dir="/tmp") as folder:
        made(GRAPH, Path(folder) / "keys")
        yield Path(folder) / "keys"


@pytest.fixture
def keys(all_keys: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(all_keys, tmp_path / "keys"))


@pytest.fixture
def hosts(keys: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Hosts]:
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:  # short: socket paths have 107 bytes
        opened = Hosts(Path(folder), keys, monkeypatch)
        yield opened
        opened.close()
