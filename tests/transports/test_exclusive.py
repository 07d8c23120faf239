"""A name belongs to one at a time, whatever becomes of him."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from robocomp_py.errors import AlreadyServed, TransportError
from robocomp_py.transports import exclusive
from robocomp_py.transports.exclusive import claim, holder, is_claimed, sweep, try_claim

NAME = "robot/world/Laser/getLaserData"


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def test_a_second_claim_names_the_holder_of_the_first(tmp_path: Path) -> None:
    first = claim(tmp_path, NAME, "world")
    with pytest.raises(AlreadyServed, match=rf"{NAME}: already served by world \(pid {os.getpid()}\)"):
        claim(tmp_path, NAME, "impostor")
    first.close()


def test_other_names_are_free(tmp_path: Path) -> None:
    claims = [claim(tmp_path, name, "world") for name in (NAME, NAME + "x")]
    for each in claims:
        each.close()


def test_names_do_not_clash_however_long(tmp_path: Path) -> None:
    claims = [claim(tmp_path, name, "") for name in ("x" * 500 + "/b", "x" * 500 + "/c")]
    assert try_claim(tmp_path, "x" * 500 + "/b", "") is None
    for each in claims:
        each.close()


def test_after_closing_it_is_free_and_nothing_is_left(tmp_path: Path) -> None:
    for _ in range(3):
        mine = claim(tmp_path, NAME, "world")
        mine.close()
        mine.close()
        assert files(tmp_path) == []


def test_what_was_given_back_is_not_claimed_but_what_was_lost_may_be(tmp_path: Path) -> None:
    mine, others = claim(tmp_path, NAME, "world"), claim(tmp_path, NAME + "x", "world")
    assert is_claimed(tmp_path, NAME)
    mine.close()
    assert not is_claimed(tmp_path, NAME)
    shutil.rmtree(tmp_path)
    assert is_claimed(tmp_path, NAME + "x")
    others.close()


def test_closing_twice_does_not_give_back_what_is_anothers(tmp_path: Path) -> None:
    first = claim(tmp_path, NAME, "world")
    first.close()
    second = claim(tmp_path, NAME, "other")
    first.close()
    with pytest.raises(AlreadyServed, match="other"):
        claim(tmp_path, NAME, "third")
    second.close()


@contextmanager
def victim(folder: Path, *names: str) -> Iterator[int]:
    """A process that has claimed names, and is killed without having given them back; its id."""
    code = f"""
import time
from pathlib import Path
from robocomp_py.transports.exclusive import claim
mine = [claim(Path({str(folder)!r}), name, "victim") for name in {names!r}]
print("here", flush=True)
time.sleep(600)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"here\n"
        yield process.pid
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_what_a_killed_process_had_is_free(tmp_path: Path) -> None:
    with victim(tmp_path, NAME) as pid, pytest.raises(AlreadyServed, match=rf"victim \(pid {pid}\)"):
        claim(tmp_path, NAME, "heir")
    claim(tmp_path, NAME, "heir").close()
    assert files(tmp_path) == []


def test_what_a_killed_process_left_is_removed_when_the_next_one_begins(tmp_path: Path) -> None:
    with victim(tmp_path, NAME, NAME + "x"):
        assert len(files(tmp_path)) == 2
    with victim(tmp_path, NAME + "y"):  # which claims another name
        assert [path.name for path in files(tmp_path)] == [f"{NAME}y.lock".replace("/", ".")]


def test_what_the_living_have_is_not_removed(tmp_path: Path) -> None:
    mine = claim(tmp_path, NAME, "world")
    with victim(tmp_path, NAME + "x") as pid:
        sweep(tmp_path)
        assert len(files(tmp_path)) == 2
    [lock] = [path for path in files(tmp_path) if path.stem.endswith("x")]
    held = os.open(lock, os.O_RDWR)
    fcntl.flock(held, fcntl.LOCK_EX)  # a process whose id is not visible
    sweep(tmp_path)
    assert len(files(tmp_path)) == 2
    with pytest.raises(AlreadyServed, match=rf"victim \(pid {pid}\)"):
        claim(tmp_path, NAME + "x", "heir")
    os.close(held)
    sweep(tmp_path)
    assert len(files(tmp_path)) == 1
    mine.close()


def test_of_many_at_once_one_has_it_also_while_others_give_it_back(tmp_path: Path) -> None:
    inside = threading.Semaphore(1)
    had = []

    def contend(number: int) -> None:
        for _ in range(200):
            try:
                mine = claim(tmp_path, NAME, str(number))
            except AlreadyServed:
                continue
            assert inside.acquire(blocking=False), "two have it"
            had.append(number)
            inside.release()
            mine.close()

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(contend, range(8)))
    assert had
    assert files(tmp_path) == []


def test_an_unsigned_claim_is_valid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exclusive, "_SIGNING", 0.1)  # it never will
    mine = claim(tmp_path, NAME, "world")
    (file,) = files(tmp_path)
    file.write_text("")
    with pytest.raises(AlreadyServed, match="a process that has just started"):
        claim(tmp_path, NAME, "impostor")
    mine.close()


def test_closing_after_the_folder_was_removed_keeps_the_new_claim(tmp_path: Path) -> None:
    folder = tmp_path / "zeromq"
    mine = claim(folder, NAME, "world")
    shutil.rmtree(folder)
    heirs = claim(folder, NAME, "heir")
    mine.close()
    with pytest.raises(AlreadyServed, match="heir"):
        claim(folder, NAME, "third")
    heirs.close()


def test_a_folder_that_cannot_be_made_is_a_transport_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TransportError, match="cannot be claimed in"):
        claim(tmp_path / "file" / "zeromq", NAME, "world")


def test_a_failed_try_returns_none_and_holder_names_the_owner(tmp_path: Path) -> None:
    mine = try_claim(tmp_path, NAME, "world")
    assert mine
    assert try_claim(tmp_path, NAME, "other") is None
    assert holder(tmp_path, NAME) == f"world (pid {os.getpid()})"
    mine.close()


def test_where_many_files_are_they_are_looked_through_once_in_a_while(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()

    def leave() -> None:
        for number in range(201):
            (tmp_path / f"{number}.lock").write_text(f"victim (pid {dead.pid})")

    leave()
    sweep(tmp_path)
    assert files(tmp_path) == [tmp_path / "swept"]
    leave()
    sweep(tmp_path)
    assert len(files(tmp_path)) == 202
    os.utime(tmp_path / "swept", (0, 0))
    sweep(tmp_path)
    assert files(tmp_path) == [tmp_path / "swept"]
