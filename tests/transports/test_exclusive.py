"""A name is held by one at a time, and by nobody once its holder is gone."""

import multiprocessing
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.errors import TransportError
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.exclusive import claim


def test_a_name_is_held_by_one_and_the_others_are_told_by_whom(tmp_path: Path) -> None:
    claim(tmp_path / "dds", "a/B/c", "camera")
    with pytest.raises(TransportError, match=rf"a/B/c: already served by camera \(pid {os.getpid()}\)"):
        claim(tmp_path / "dds", "a/B/c", "other")
    claim(tmp_path / "dds", "a/B/d", "other")


def test_a_closed_claim_frees_the_name_and_leaves_no_file(tmp_path: Path) -> None:
    for _ in range(3):
        held = claim(tmp_path, "a/B/c", "camera")
        held.close()
        held.close()
    assert list(tmp_path.iterdir()) == []


def test_a_killed_holder_frees_the_name(tmp_path: Path) -> None:
    spawn = multiprocessing.get_context("spawn")
    holds = spawn.Event()
    holder = spawn.Process(target=_hold, args=(tmp_path, holds))
    holder.start()
    assert holds.wait(SOON)
    with pytest.raises(TransportError, match=rf"pid {holder.pid}\)"):
        claim(tmp_path, "a/B/c", "other")
    holder.kill()
    holder.join()
    claim(tmp_path, "a/B/c", "other").close()


def _hold(folder: Path, holds: Any) -> None:
    held = claim(folder, "a/B/c", "camera")
    holds.set()
    signal.pause()
    held.close()
