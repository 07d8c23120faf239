"""Only one may have it, as long as it lives."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.errors import AlreadyServed
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.exclusive import claim, try_claim


def test_a_claim_is_refused_naming_who_has_it(tmp_path: Path) -> None:
    claim(tmp_path, "a/b/c", "world")
    with pytest.raises(AlreadyServed, match=rf"a/b/c: already served by world \(pid {os.getpid()}\)"):
        claim(tmp_path, "a/b/c", "other")


def test_what_was_released_can_be_claimed_again_and_leaves_nothing(tmp_path: Path) -> None:
    for _ in range(3):
        held = claim(tmp_path, "a/b/c", "world")
        held.close()
        held.close()
    assert os.listdir(tmp_path) == []


def test_different_names_do_not_clash_however_long(tmp_path: Path) -> None:
    held = [claim(tmp_path, name, "") for name in ("a/b", "a/c", "x" * 500 + "/b", "x" * 500 + "/c")]
    assert len(os.listdir(tmp_path)) == len(held)
    assert try_claim(tmp_path, "x" * 500 + "/b", "") is None


def test_the_dead_hold_nothing(tmp_path: Path) -> None:
    code = f"""
import time
from pathlib import Path
from robocomp_py.transports.exclusive import claim
held = claim(Path({str(tmp_path)!r}), "a/b/c", "victim")
print("held", flush=True)
time.sleep(1000)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as victim:
        assert victim.stdout is not None
        assert victim.stdout.readline() == "held\n"
        with pytest.raises(AlreadyServed, match=rf"victim \(pid {victim.pid}\)"):
            claim(tmp_path, "a/b/c", "")
        victim.send_signal(signal.SIGKILL)
    wait_until(lambda: try_claim(tmp_path, "a/b/c", "heir"))
