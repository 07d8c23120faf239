"""What a transport declares for deployment: its second, optional entry point.

    [project.entry-points."robocomp_py.deployments"]
    NAME = "MODULE:CLASS"      a subclass of `Deployment`, under the name of the transport

`rcdeploy`, the checkers and the pictures read it on machines where the middleware is not installed. So its module must
not import the middleware, nor at its top what only plans of networks need: tools that look at what runs import it, too.
A transport without a deployment side works on one host, and `security lan` refuses it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from .. import installed

if TYPE_CHECKING:
    from ..contract.component import Component, Port
    from ..contract.parameters import Complaint, Key
    from .census import Told
    from .network import Helper, Network, Placement, Wiring
    from .permissions import Graph

OTHER_COLOUR = "#1f6fb2"


class Near(StrEnum):
    """How close two instances are to each other."""

    PROCESS = "one process"
    HOST = "one host"


@dataclass(frozen=True)
class Reached:
    """An address at which a transport listens, or to which it connects."""

    what: str
    """`listens at`, `connects to`: with the address behind it."""
    address: str
    """`KIND://HOST:PORT` or `KIND/HOST:PORT`: see `is_loopback`."""
    unencrypted: str = ""
    """If what travels there is not encrypted although the transport is protected: what to write instead."""


@dataclass(frozen=True)
class Completion:
    """What follows for another key of a configuration from an option of a transport."""

    key: Key
    value: Any
    said_by: Key


class Sourced(Protocol):
    """The settings of a port or of one of its operations."""

    @property
    def source(self) -> str | None:
        """The instance whose channels are used."""


class SettingsOfPorts(Protocol):
    """A configuration, as far as it is about ports."""

    @property
    def middleware(self) -> str | None: ...

    @property
    def ports(self) -> Mapping[tuple[str, ...], Sourced]:
        """Keys are (port,) and (port, operation)."""

    def middlewares(self, port: Port, operation: str, generated_for: str) -> list[str]:
        """The middlewares of an operation of a port, the main one first."""


@dataclass(frozen=True)
class Incomplete:
    """A component whose configuration is set except for what follows from options of transports."""

    component: Component
    own: Port | None
    """The port of its `CommonBehavior`."""
    settings: Callable[[], SettingsOfPorts]
    generated_for: str
    """The middleware of its generic part."""
    is_overridden: bool
    """Whether something other than the file decides what a port uses."""


class Deployment:
    """The deployment side of a transport. The values here are those of a transport that declares nothing."""

    missing = ""
    """Why nothing is declared."""
    summary = ""
    """What the transport is, in a few words."""
    colour = OTHER_COLOUR
    """Its arrows in pictures of networks."""
    near: Near | None = None
    """`auto` prefers the transport for instances that are so close to each other."""
    crosses_hosts = False
    """Whether `wire` connects instances on different hosts."""
    unprotected = "its deployment side does not declare what keeps strangers out"
    """Why strangers may take part or listen; "" if they cannot. `security lan` refuses all others."""
    keyed = False
    """Whether it has the option `keys`: a folder that `rcdeploy keys` makes for each process."""
    shares = True
    """Whether its components share a program, which the `host` of its factory runs with their options."""
    ports_of_interfaces = False
    """Whether each interface that an instance provides to another host has a port of its own."""
    directory = ""
    """Its folder in the run-time folder, if its processes announce there what they offer and use: often its `name`."""
    longest_socket = ""
    """The longest path that a socket of it may have below the run-time folder."""
    leaves_memory = False
    """Whether opening and closing it removes what killed processes left outside of the run-time folder."""
    shared_memory = ""
    """The file system of shared memory that its messages are in."""
    modules: tuple[tuple[str, str], ...] = ()
    """What a host must have: a module, and the package that contains it, of each."""

    def place(self, network: Network) -> Placement:
        """Where the interfaces of instances are, if they have `ports_of_interfaces`; `wire` is asked afterwards.

        A `port` of an instance is that of its first interface. What other transports use of it begins behind its last.
        """
        from .network import Placement

        return Placement()

    def wire(self, network: Network) -> Wiring:
        """How instances find each other, given all that the transport carries between them."""
        from .network import Refusal, Wiring

        why = f" ({self.missing})" if self.missing else ""
        hint = f"name another one, {network.default} say, or leave it open"
        return Wiring(
            refusals=tuple(
                Refusal(
                    way,
                    f"`{network.middleware}` does not reach other hosts{why}, and is to carry `{way.interface}` "
                    f"between {network.between(way)}",
                    hint,
                )
                for way in network.crossing()
            )
        )

    def census(self, options: Mapping[str, Any]) -> list[Told] | None:
        """All ends of channels that processes announce now, for a process with these options; None if it cannot tell.

        Opens no link. Raises TransportError.
        """
        if not self.directory:
            return None
        from .directory import census  # most commands do without

        return census(self.directory)

    @contextmanager
    def asking(self, options: Mapping[str, Any]) -> Iterator[Callable[[], list[Told] | None]]:
        """Begin a census; the function that this yields completes it. A transport that has to wait for what others tell
        opens its links on entry, so that the caller can do something else in the meantime.

        Entering it and the function may raise TransportError.
        """
        yield partial(self.census, options)

    def examine(self, options: Mapping[str, Any]) -> Iterator[Complaint]:
        """What is wrong with the options of an instance, before it opens anything."""
        yield from ()

    def complete(self, options: Mapping[str, Any], of: Incomplete) -> Iterator[Complaint | Completion]:
        """What options mean to the ports of a component, once everything else is set."""
        yield from ()

    def outside(self, options: Mapping[str, Any], channel: str) -> str:
        """Where an instance finds a channel outside of its network, as its options say; "" if they do not."""
        return ""

    def reaching(self, programs: Mapping[str, str]) -> Mapping[str, Any]:
        """The options of a tool that uses channels of foreign programs, each at a place of `Placement.programs`."""
        return {}

    def hearing(self, topics: Mapping[str, Mapping[str, Any]]) -> Iterable[tuple[Mapping[str, Any], Sequence[str]]]:
        """How a tool hears topics of foreign programs: sets of options, each with the channels that are heard with it.

        `topics` are the channels, each with what `Placement.publishers` has of its program.
        """
        return ()

    def published(self, options: Mapping[str, Any], channels: Collection[str]) -> Collection[str]:
        """Those of such topics that there are now, for a tool with options of `hearing`; within half a second."""
        return channels

    def at_port(self, port: int) -> Mapping[str, Any]:
        """The options of an instance on this machine to which its network gives a `port`; 0 is that it needs none."""
        return {}

    def reached(self, options: Mapping[str, Any]) -> Iterator[Reached]:
        """The addresses that an instance or a helper opens with these options."""
        yield from ()

    def memory_files(self) -> list[Path]:
        """The files outside of the run-time folder by which its processes share memory, if it `leaves_memory`."""
        return []

    def crowded(self, connections: int) -> str:
        """Why this host cannot carry so many pairs of a client and a provider; "" if it can."""
        return ""

    def key_pair(self) -> tuple[bytes, bytes]:
        """A new public and secret key of a process, 40 characters of Z85 each; empty if it needs none."""
        return b"", b""

    def observing(self, options: Mapping[str, Any], address: str) -> Mapping[str, Any]:
        """The options of a tool on a host whose components have these options; empty if it needs none, as where all
        meet in a folder. `address` is that of the host for others, "" for the machine of `rcdeploy`.
        """
        return {} if self.directory else options

    def visiting(self, options: Mapping[str, Any], keys: str, *, is_here: bool) -> Mapping[str, Any]:
        """The options of a tool that takes part by a helper with these options, as the operator whose folder of keys
        this is; empty if it needs none. `is_here`: whether the helper runs on this host.
        """
        return {}

    def secured(self, helper: Helper, graph: Graph, folder: Path, numbers: Mapping[str, int]) -> Mapping[str, Any]:
        """The options of a helper which is to let in only members of the graph.

        `folder` has its `ca.pem`, `certificate.pem` and `key.pem`; `numbers` has the number of each process.
        """
        return helper.options


class Undeclared(Deployment):
    """Stands for the deployment side of a transport which has none that could be loaded."""

    def __init__(self, missing: str = "its transport has no deployment side") -> None:
        self.missing = self.unprotected = missing


def deployment_of(middleware: str) -> Deployment:
    """The deployment side of a transport, by its name. Does not import the middleware, and never fails."""
    try:
        found: type[Deployment] | None = installed.find(installed.DEPLOYMENTS, middleware)
    except ImportError as exc:
        return Undeclared(f"its deployment side cannot be loaded: {exc}")
    return found() if found else Undeclared()


def deployments() -> dict[str, Deployment]:
    """All installed ones, by the names of their transports."""
    return {name: deployment_of(name) for name in installed.entries(installed.DEPLOYMENTS)}


_LOCAL = ("here", "ipc", "inproc", "unixsock-stream", "unixpipe")


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches what is at an address of a transport: `KIND://HOST:PORT` or `KIND/HOST:PORT`.

    For `tcp`, `tls`, `udp`, `quic`, `ws` and no kind the host decides. `here`, `ipc`, `inproc`, `unixsock-stream` and
    `unixpipe` are local, all other kinds are not.
    """
    import ipaddress

    kind, _, rest = address.partition("://") if "://" in address else address.partition("/")
    if not rest:
        rest = address
    elif kind not in ("tcp", "tls", "udp", "quic", "ws"):
        return kind in _LOCAL  # names of others are not known to us
    host = re.sub(r"[?#].*", "", rest)
    host = host.rpartition(":")[0] if re.search(r":(\d+|\*)$", host) else host
    host = host.strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False  # a name, which may belong to any host, or `*`
