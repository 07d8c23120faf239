"""What a process says of itself, read from a datagram that may contain anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.deploy.agents import Life
from robocomp_py.deploy.launcher.cgroups import where
from robocomp_py.deploy.launcher.notes import Note, read
from robocomp_py.deploy.launcher.traces import read as read_stat


def test_what_sd_notify_defines_is_understood() -> None:
    told = b"READY=1\nRELOADING=1\nSTOPPING=1\nSTATUS=a\x1b[31m b\nWATCHDOG=1\nWATCHDOG_USEC=2500000"
    told += b"\nMAINPID=7\nNOTIFYACCESS=exec"
    assert read(told) == Note(
        ready=True,
        stopping=True,
        status="a [31m b",
        fed=True,
        watchdog_s=2.5,
        main_pid=7,
        access="main",
    )
    assert read(b"WATCHDOG=trigger").stuck


def test_what_components_add_to_it_is_understood() -> None:
    note = read(b"X_ROBOCOMP_ENDED=arm\nX_ROBOCOMP_ENDED=laser\nX_ROBOCOMP_CALLS=12.5 3e2")
    assert (note.ended, note.calls) == (["arm", "laser"], (12.5, 300.0))
    note = read(b"X_ROBOCOMP_LIFE=arm emergency 12 3 1 0.1.0\nX_ROBOCOMP_LIFE=laser compute -1 0 0 0.1.0")
    assert note.lives == {"arm": Life("emergency", 12, 3, 1, "0.1.0")}


@pytest.mark.parametrize(
    "told", [b"", b"READY", b"READY=0", b"WATCHDOG_USEC=-1", b"MAINPID=x", b"MAINPID=99999999999", b"FDSTORE=1"]
)
def test_what_means_nothing_is_passed_over(told: bytes) -> None:
    assert read(told) == Note()


@pytest.mark.parametrize("numbers", [b"nan 1", b"1", b"1 2 3", b"inf 0", b"-1 0"])
def test_invalid_numbers_are_ignored(numbers: bytes) -> None:
    assert read(b"X_ROBOCOMP_CALLS=" + numbers).calls is None


@given(
    st.binary(max_size=300),
    st.sampled_from([b"", b"WATCHDOG_USEC=", b"MAINPID=", b"X_ROBOCOMP_CALLS=", b"X_ROBOCOMP_LIFE=", b"STATUS="]),
)
def test_no_datagram_does_harm(told: bytes, key: bytes) -> None:
    note = read(key + told)
    assert note.status is None or note.status.isprintable()


def test_a_process_may_be_called_anything() -> None:
    line = b"42 (a) R 7 8) S 1 42 41 0 -1 4194304 1 2 3 4 10 20 30 40 20 0 1 0 4711 1000 256 0"
    trace = read_stat(42, line)
    assert (trace.state, trace.parent, trace.session, trace.started) == ("S", 1, 41, 4711)
    assert (trace.cpu_ticks, trace.memory_pages) == (100, 256)


def test_the_group_of_a_process_is_found_wherever_groups_are_mounted() -> None:
    first = "31 25 0:27 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw"
    second = "30 25 0:26 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw"
    assert where(f"{first}\n{second}", "1:cpu:/x\n0::/user.slice/a") == Path("/sys/fs/cgroup/unified/user.slice/a")
    container = r"30 25 0:26 /docker/x /sys/fs/with\040space rw - cgroup2 cgroup2 rw"
    assert where(container, "0::/docker/x/y") == Path("/sys/fs/with space/y")
    assert where(container, "0::/other") is None
    assert where(first, "1:cpu:/x") is None
