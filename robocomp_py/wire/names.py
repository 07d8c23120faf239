"""Names of channels, in one place.

    <namespace>/<instance>/<Interface>/<operation>      robot1/world/Laser/getLaserData

The namespace may be empty or have several segments. The instance is the one that provides the
operation. A client without a configured instance writes `*`: it uses any other instance of its
namespace. A subscriber that writes `*` receives from all of them.
"""

from __future__ import annotations

import re

ANY = "*"
_SEGMENT = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*\Z")


def channel(namespace: str, instance: str, interface: str, operation: str) -> str:
    return "/".join((*filter(None, (namespace.strip("/"),)), instance, interface, operation))


def tail(channel: str) -> str:
    """Interface and operation, which are the same in all matching channels."""
    return "/".join(channel.split("/")[-2:])


def resolve(target: str, namespace: str, interface: str) -> tuple[str, str, str]:
    """The instance that the `from` of a port means, as (namespace, instance, interface).

    `world` is an instance of the same namespace, `world/Laser1` one of its ports, and
    `/robot2/world/Laser` is a full name. "" is any instance.
    """
    if not target:
        return namespace, ANY, interface
    parts = target.strip("/").split("/")
    if not all(is_segment(part) for part in parts):
        raise ValueError(f"{target!r} names no instance; write `instance`, `instance/Interface` or `/namespace/…`")
    if target.startswith("/"):
        if len(parts) < 2:
            raise ValueError(f"{target!r} lacks a part; write `/namespace/instance/Interface`")
        return "/".join(parts[:-2]), parts[-2], parts[-1]
    if len(parts) > 2:
        raise ValueError(f"{target!r} has too many parts; a name with a namespace begins with `/`")
    return namespace, parts[0], parts[1] if len(parts) == 2 else interface


def whole(instance: str, namespace: str) -> str:
    """The name of an instance from the root, as `/robot1/world`. One that begins with a slash is that already."""
    return instance if instance.startswith("/") else "/" + "/".join(filter(None, (namespace.strip("/"), instance)))


def target(namespace: str, instance: str, segment: str, own: str, interface: str) -> str:
    """A `from` that means `segment` of an instance, for a client of `interface` in the namespace `own`."""
    if namespace.strip("/") == own.strip("/"):
        return instance if segment == interface else f"{instance}/{segment}"
    return "/" + "/".join(filter(None, (namespace.strip("/"), instance, segment)))


def instance(channel: str) -> str:
    """The instance that provides a channel."""
    return channel.split("/")[-3]


def segment(channel: str) -> str:
    """The interface in the name of a channel: `Laser`, `Laser1`."""
    return channel.split("/")[-2]


def within(named: str, segment: str) -> str:
    """An interface among all that a component provides: `Laser`, or `front/Laser` of a named instance."""
    return f"{named}/{segment}" if named else segment


def operation(channel: str) -> str:
    return channel.rpartition("/")[2]


def is_segment(text: str) -> bool:
    """Whether a name may be a part of a channel's name."""
    return bool(_SEGMENT.match(text))


def is_namespace(text: str) -> bool:
    return not text or all(is_segment(part) for part in text.strip("/").split("/"))


def matches(pattern: str, name: str) -> bool:
    """Whether a channel has this name, which may have `*` for the instance."""
    place = pattern.rfind(ANY)
    if place < 0:
        return pattern == name
    behind = pattern[place + 1 :]
    if not name.endswith(behind):  # most names differ there, and this is soon seen
        return False
    if not place and behind.startswith("/"):  # so are most patterns
        return "/" not in name[: -len(behind)]
    wanted, given = pattern.split("/"), name.split("/")
    return len(wanted) == len(given) and all(w in (ANY, g) for w, g in zip(wanted, given, strict=True))
