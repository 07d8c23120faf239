"""What scouts tell of the ends of channels on their hosts. It comes from outside, and is checked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..transports.census import Told
from .census import Seen
from .network import End
from .posts import Message, Post, ask_all

CENSUS_TIMEOUT = 20.0
"""Seconds in which a scout starts and tells what runs on its host."""


def survey(posts: Sequence[Post], middlewares: Sequence[str]) -> tuple[Seen, dict[str, str]]:
    """What scouts tell of their hosts, all at a time; and why a host could not be asked, by its name."""
    seen = Seen()
    answers, lost = ask_all(posts, "census", CENSUS_TIMEOUT, middlewares=list(middlewares))
    for post, found in answers.items():
        seen.ends.extend(told_in(found, post))
        seen.troubles.extend(f"{post.host}: {each}" for answer in found for each in _texts(answer.get("troubles")))
        seen.tellers[post.host] = frozenset(each for answer in found for each in _texts(answer.get("tellers")))
    return seen, lost


def told_in(answers: Iterable[Message], post: Post) -> list[End]:
    """The ends in the answers of a scout. What is not understood is left out."""
    found: list[End] = []
    texts: dict[str, str] = {}
    for answer in answers:
        given = answer.get("texts")
        for key, text in given.items() if isinstance(given, dict) else ():
            texts[str(key)] = str(text)
        ends = answer.get("ends")
        for each in ends if isinstance(ends, list) else ():
            match each:
                case [
                    str(middleware), str(owner), int(pid), str(role), str(channel), int(fingerprint), str(traits)
                ]:  # fmt: skip
                    text = texts.get(f"{fingerprint:x}", "")
                    told = Told(owner, pid, role, channel, fingerprint, text, traits)
                    found.append(End(middleware, told, post.host, post))
                case _:
                    continue
    return found


def _texts(given: Any) -> list[str]:
    return [str(each) for each in given] if isinstance(given, list) else []


def merged(
    here: Iterable[End], elsewhere: Iterable[End], host_of: Mapping[str, str], local: Callable[[str], bool]
) -> list[End]:
    """All ends, each once: some middlewares tell on one host what runs on another one, too.

    `host_of` tells the hosts of components, by their whole names; `local` whether a middleware tells of its host only.
    """
    found: dict[Any, End] = {}
    for each in (*here, *elsewhere):
        host = each.host if local(each.middleware) else host_of.get(each.told.owner)
        told = each.told
        key = each.middleware, host, told.owner, told.pid, told.role, told.channel, told.fingerprint
        found.setdefault(key, each if host is None else replace(each, host=host))
    return list(found.values())
