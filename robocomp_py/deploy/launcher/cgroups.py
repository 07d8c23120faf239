"""Control groups (version 2): a process cannot leave its group, so ending the group ends all that a process started.

If the system has none, or allows none to be made, the launcher works without. Standard library only.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from pathlib import Path


def make(name: str) -> Path | None:
    """Make a group below that of this process; None if that is impossible."""
    own = _own()
    if own is None:
        return None
    group = own / name
    try:
        group.mkdir()
    except OSError:
        return None
    if _can_kill(own, group):
        return group
    remove(group)
    return None


def child(group: Path, name: str) -> Path | None:
    """Make a group for a process inside another one; None if that fails."""
    made = group / name
    try:
        made.mkdir(exist_ok=True)
    except OSError:
        return None
    return made


def enter(group: str) -> None:
    """Move the calling process into it, with all that it starts from now on. Raises OSError."""
    with open(f"{group}/cgroup.procs", "w") as members:
        members.write("0")


def populated(group: Path) -> bool:
    """Whether processes live in it or below it; True if that is unknown."""
    try:
        return "populated 1" in (group / "cgroup.events").read_text()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:  # no descriptor is left, say
        return True


def kill(group: Path) -> None:
    """End all that is in it and below it, at once."""
    with contextlib.suppress(OSError):
        (group / "cgroup.kill").write_text("1")


def members(group: Path) -> list[int]:
    """The known processes in it and below it."""
    files = [group / "cgroup.procs"]
    with contextlib.suppress(OSError):  # no descriptor is left
        files += group.glob("*/**/cgroup.procs")
    found: list[int] = []
    for file in files:
        with contextlib.suppress(OSError, ValueError):
            found += map(int, file.read_text().split())
    return found


def remove(group: Path) -> bool:
    """Remove it with those below it, if no process lives there any more. Returns whether it is gone."""
    with contextlib.suppress(OSError):  # there is nothing below, mostly
        group.rmdir()
        return True
    with contextlib.suppress(OSError):
        for inner in sorted(group.glob("**/"), key=lambda each: len(each.parts), reverse=True):
            if inner != group:
                inner.rmdir()
    with contextlib.suppress(OSError):
        group.rmdir()
    return not group.exists()


def end(group: Path, within: float = 2.0) -> bool:
    """Kill what is in it and remove it; blocks for at most `within` seconds. Returns whether it is gone."""
    give_up = time.monotonic() + within
    kill(group)
    while not remove(group) and time.monotonic() < give_up:
        time.sleep(0.01)
    return not group.exists()


def _own() -> Path | None:
    try:
        mounts = Path("/proc/self/mountinfo").read_text()
        groups = Path("/proc/self/cgroup").read_text()
    except OSError:
        return None
    return where(mounts, groups)


def where(mountinfo: str, groups: str) -> Path | None:
    """The folder of the group that a process is in, from what /proc says of it."""
    inside = next((line.removeprefix("0::") for line in groups.splitlines() if line.startswith("0::")), None)
    for line in mountinfo.splitlines():
        before, _, after = line.partition(" - ")
        if inside is not None and after.split(" ")[:1] == ["cgroup2"]:
            root, point = (_unescaped(word) for word in before.split(" ")[3:5])
            if root == "/" or inside == root or inside.startswith(f"{root}/"):
                below = inside if root == "/" else inside.removeprefix(root)
                return Path(point + below) if below != "/" else Path(point)
    return None


def _unescaped(word: str) -> str:
    return re.sub(r"\\([0-7]{3})", lambda found: chr(int(found[1], 8)), word)


def _can_kill(own: Path, group: Path) -> bool:
    """Whether processes can be moved from one into the other, and the kernel can end it whole."""
    return (group / "cgroup.kill").exists() and all(os.access(each / "cgroup.procs", os.W_OK) for each in (own, group))
