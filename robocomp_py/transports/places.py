"""The index of a directory: places, which hold links to the files of the members that use them.

    <folder>/by/<place>/<id>    a symbolic link to the file of a member, which uses channels of this place

A place stands for one interface of one instance. A member that looks for it reads that place only. Each interface
has two more places: one for members that name no instance, and one for all members. See `Places`.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from ..wire.names import ANY
from .exclusive import SWEPT, file_name
from .inotify import UNWATCHED
from .members import member_in

INDEX = "by"
"""The name of the folder of places."""

OF_MEMBERS = (".json", ".lock")
"""Suffixes of the files of members. A member that was killed while leaving may have no lock any more."""

_TRIES = 100
"""Maximum attempts to create a place that leaving members remove again."""

_ALL = "**"
"""Stands for the instance in the name of a place for all members."""


class Places(NamedTuple):
    """The places of a channel.

    They are named by the part of its name that all operations of its interface share: `robot/world/Laser`.
    """

    own: str
    """For members that use exactly this name."""
    all: str
    """For all members of this interface, with or without an instance."""
    star: str
    """For members that name no instance; equals `own` if the channel names none."""

    def sought(self) -> tuple[str, ...]:
        """The places to look into for peers of the channel."""
        return (self.all,) if self.own == self.star else (self.own, self.star)

    def announced(self) -> tuple[str, ...]:
        """The places where users of the channel are announced."""
        return self.own, self.all


def places_of(channel: str) -> Places:
    return _places_below(channel.rpartition("/")[0] or channel)


@lru_cache(1000)
def _places_below(beginning: str) -> Places:
    *above, interface = beginning.split("/")
    of_all, of_star = (file_name("/".join((*above[:-1], each, interface))) for each in (_ALL, ANY))
    return Places(file_name(beginning), of_all, of_star)


def make_place(place: str) -> None:
    """Create the folder of a place, and that of the index, if they are missing."""
    for folder in (os.path.dirname(place), place):
        with contextlib.suppress(FileExistsError):
            os.mkdir(folder, 0o700)


def link_into(place: str, member_id: str) -> None:
    """Create a link in a place to the file of a member."""
    for _ in range(_TRIES):
        try:
            os.symlink(f"../../{member_id}.json", os.path.join(place, member_id))
        except FileNotFoundError:  # the place has no members yet, or the last one has just left
            with contextlib.suppress(FileNotFoundError):  # or is just leaving
                make_place(place)
        else:
            return
    raise OSError(errno.EAGAIN, "it is removed again and again")


def withdraw_from(place: str, member_id: str) -> None:
    """Remove such a link, and the place with its last member."""
    with contextlib.suppress(OSError):
        os.unlink(os.path.join(place, member_id))
    # the others stay: many members look there, although they are mostly empty
    if _ALL not in place and ANY not in place:
        with contextlib.suppress(OSError):
            os.rmdir(place)


def remove_all(folder: Path, member_id: str, places: Iterable[str]) -> None:
    """Remove all files of a member, and its links in these places; with the last member, the index, too."""
    for place in places:
        withdraw_from(os.path.join(folder, INDEX, place), member_id)
    for suffix in OF_MEMBERS:  # also if no descriptor is left, by which the folder can be listed
        (folder / f"{member_id}{suffix}").unlink(missing_ok=True)
    others = False
    for name in os.listdir(folder):
        if name.startswith(member_id):
            (folder / name).unlink(missing_ok=True)
        elif "-" in name and name.endswith(".lock"):  # shm has another kind of lock file, without a dash
            others = True
    if not others:
        _remove_index(folder)


def places_of_dead(folder: Path, member_id: str) -> Iterable[str]:
    """The places with links to a member that may have been killed at any moment."""
    try:
        entries = member_in(content_of(folder / f"{member_id}.json"), member_id).entries
    except (OSError, ValueError, TypeError, KeyError):  # killed while joining or leaving
        index = folder / INDEX
        return os.listdir(index) if index.exists() else ()
    return {place for entry in entries for place in places_of(entry.channel).announced()}


def _remove_index(folder: Path) -> None:
    """Remove the index after the last member. Links of a member that is just joining stay."""
    index = os.path.join(folder, INDEX)
    with contextlib.suppress(OSError):
        for mark in (SWEPT, UNWATCHED):
            (folder / mark).unlink(missing_ok=True)
        for place in (os.path.join(index, name) for name in os.listdir(index)):
            with contextlib.suppress(OSError):
                for link in (os.path.join(place, name) for name in os.listdir(place)):
                    if not os.path.exists(link):  # of a member that was killed while leaving
                        os.unlink(link)
                os.rmdir(place)
        os.rmdir(index)


def content_of(path: str | Path) -> bytes:
    """The octets of a file. Raises OSError."""
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)  # twice as fast as `open`; there are many files
    try:
        parts = []
        while part := os.read(file, 65536):
            parts.append(part)
        return b"".join(parts)
    finally:
        os.close(file)
