"""What is known of control groups when the process has no descriptor left."""

from __future__ import annotations

import contextlib
import os
import resource
from collections.abc import Iterator
from pathlib import Path

from robocomp_py.deploy.launcher import cgroups


@contextlib.contextmanager
def no_descriptors() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.ExitStack() as taken:
        highest = max(map(int, os.listdir("/proc/self/fd")))
        resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 1, hard))
        taken.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        with contextlib.suppress(OSError):
            while True:
                taken.callback(os.close, os.open(os.devnull, os.O_RDONLY))
        yield


def test_without_descriptors_nothing_fails_and_no_group_counts_as_empty(tmp_path: Path) -> None:
    (tmp_path / "cgroup.procs").write_text("4711\n")
    (tmp_path / "cgroup.events").write_text("populated 0\n")
    with no_descriptors():
        members, populated = cgroups.members(tmp_path), cgroups.populated(tmp_path)
    assert (members, populated) == ([], True)
    assert (cgroups.members(tmp_path), cgroups.populated(tmp_path)) == ([4711], False)
    assert not cgroups.populated(tmp_path / "gone")
