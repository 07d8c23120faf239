"""Domains: how they are configured, and one per number and process."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import logging
import os
import re
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain

from ...errors import ConfigurationError, TransportError
from ..memory import keep_memory
from .library import creating, forget

log = logging.getLogger("robocomp.transport.dds")

_libc = ctypes.CDLL(None, use_errno=True)
"""For options of sockets that are not Python's, whose objects would change more about them than that."""


def settings(
    interface: str, domain: int = 0, peers: Sequence[str] = (), many: bool = False
) -> dict[tuple[str, str], str]:
    """Our configuration of a domain: elements by section and name.

    `interface` is a name, or an IPv4 address of this host; `peers` are the hosts to meet, without multicast;
    `many` is whether more than a few dozen processes meet.
    """
    here = interface == "lo"
    found = {
        ("General", "MaxMessageSize"): "65500B" if here else "1400B",
        ("Discovery", "ParticipantIndex"): "auto",
        ("Discovery", "MaxAutoParticipantIndex"): "250",
        ("Discovery", "SPDPInterval"): "1s",
        ("Discovery", "LeaseDuration"): "2s",
        ("Internal", "SocketReceiveBufferSize"): '<SocketReceiveBufferSize max="20MB"/>',
        ("Internal", "Watermarks"): (
            "<WhcLow>8MB</WhcLow><WhcHigh>32MB</WhcHigh><WhcHighInit>32MB</WhcHighInit><WhcAdaptive>false</WhcAdaptive>"
        ),
        ("Tracing", "Verbosity"): "severe",
        ("Tracing", "OutputFile"): "stderr",  # not a file in whatever folder we are in
    }
    if interface:
        kind = "address" if is_address(interface) else "name"
        found["General", "Interfaces"] = f"<NetworkInterface {kind}={quoteattr(interface)}/>"
    if many:
        # Five writers of the library in each process ask all others whether they have got everything, until the last
        # newcomer has said so: ten times a second by default, which is more than they can answer. Large messages pay
        # for it: if the last part of one is lost, that is noticed by such a question.
        found["Internal", "HeartbeatInterval"] = "500ms"
    if peers:
        found["General", "AllowMulticast"] = "false"
        found["Discovery", "MaxAutoParticipantIndex"] = "120"  # so many ports of each peer are told that we are here
        # One that was out of reach is told again when it is back, whoever of us was there first.
        told = (f'<Peer Address={quoteattr(peer)} PruneDelay="inf"/>' for peer in peers)
        found["Discovery", "Peers"] = "".join(told)
    if here:
        found["General", "FragmentSize"] = "63000B"
        found["Internal", "NackDelay"] = "10ms"  # what is lost here did not fit the socket's buffer: ask at once
        found["Internal", "MaxQueuedRexmitBytes"] = "16MB"
        found["General", "AllowMulticast"] = "false"
        # Who starts tells all participants that there might be, and hears from those that there are. To go on telling
        # the 250 others every second, as the library does for half a minute, takes 0.2 % of a core.
        found["Discovery", "InitialLocatorPruneDelay"] = "2s"
        found["Discovery", "Peers"] = '<Peer Address="127.0.0.1"/>' + "".join(map(partial(_beacon, domain), _own()))
    return found


def _beacon(domain: int, address: str) -> str:
    """Where programs of this host that use the library as it is listen for others.

    They expect these by multicast on one network interface. We tell that address of our own, which
    leaves the host as little as what we send to 127.0.0.1.
    """
    return f'<Peer Address="{address}:{7400 + 250 * domain}" PruneDelay="inf"/>'


def is_address(interface: str) -> bool:
    """Whether that is the IPv4 address of an interface, and not its name."""
    return re.fullmatch(r"\d{1,3}(\.\d{1,3}){3}", interface) is not None


def _own() -> list[str]:
    """The IPv4 addresses of this host, as far as it tells them."""
    try:
        names = [name for _, name in socket.if_nameindex()] if sys.platform == "linux" else []
    except OSError:
        return []
    return [address for address in map(address_of, names) if address]


def address_of(interface: str) -> str:
    """The IPv4 address of a network interface, or nothing."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            answer = fcntl.ioctl(asking, _SIOCGIFADDR, struct.pack("40s", interface.encode()[:15]))
    except OSError:
        return ""
    return socket.inet_ntoa(answer[20:24])


_SIOCGIFADDR = 0x8915


LITTLE = 1_000_000
"""Octets that a socket should be able to hold, at least."""


def note_on_sockets(limit: str) -> str:
    """What to tell people about this `net.core.rmem_max`, if anything."""
    if not limit.isdecimal() or int(limit) >= LITTLE:
        return ""
    return (
        f"dds: a socket of this host holds {int(limit) // 1000} KB at most, so parts of large messages may get lost "
        "while it is busy, and be sent again; for more: sysctl -w net.core.rmem_max=20000000"
    )


def _limit_of_sockets() -> str:
    try:
        with open("/proc/sys/net/core/rmem_max", encoding="ascii") as file:
            return file.read().strip()
    except OSError:  # not Linux, or hidden from us
        return ""


_WHERE = {("General", "Interfaces"), ("General", "AllowMulticast"), ("Discovery", "Peers")}
"""Ours for one network make no sense beside the user's choice of another."""


def compose(ours: Mapping[tuple[str, str], str], uri: str, domain: int) -> str:
    """Our configuration with the user's (`CYCLONEDDS_URI`) behind it; where both set something, ours is left out."""
    theirs = _elements(uri, domain)
    chosen = {("general", "interfaces"), ("general", "networkinterfaceaddress")} & theirs
    out = ElementTree.Element("CycloneDDS")
    inside = ElementTree.SubElement(out, "Domain", Id="any")
    sections: dict[str, ElementTree.Element] = {}
    for key, value in ours.items():
        section, name = key
        if (section.lower(), name.lower()) in theirs or (chosen and key in _WHERE):
            continue
        if section not in sections:
            sections[section] = ElementTree.SubElement(inside, section)
        whole = value if value.startswith(f"<{name}") else f"<{name}>{value}</{name}>"
        sections[section].append(ElementTree.fromstring(whole))
    text = ElementTree.tostring(out).decode()
    if not uri.isascii():
        raise ConfigurationError("CYCLONEDDS_URI: Cyclone DDS takes ASCII only")
    return f"{text},{uri}" if uri.strip() else text


def _elements(uri: str, domain: int) -> set[tuple[str, str]]:
    """What a configuration sets for this domain, as section and element, in lower case."""
    found: set[tuple[str, str]] = set()
    for where, text in _documents(uri):
        for section in _sections(_parsed(where, text), domain):
            found |= {(section.tag.lower(), element.tag.lower()) for element in section}
    return found


_AROUND = "<all>"
"""A configuration may be a row of elements, which no XML document may."""


def _parsed(where: str, text: str) -> ElementTree.Element:
    bare = _without_prologue(text)
    try:
        return ElementTree.fromstring(f"{_AROUND}{bare}</all>")
    except ElementTree.ParseError as exc:
        line, column = exc.position
        before = text[: len(text) - len(bare)]
        column += 1 - (len(_AROUND) if line == 1 else 0) + (len(before.rpartition("\n")[2]) if line == 1 else 0)
        line += before.count("\n")
        what = str(exc).partition(":")[0]
        raise ConfigurationError(f"{where}: not well-formed XML: {what} (line {line}, column {column})") from exc


def _documents(uri: str) -> Iterator[tuple[str, str]]:
    """What a configuration consists of, each part with where it stands."""
    if uri.lstrip().startswith("<"):
        yield "CYCLONEDDS_URI", uri.replace(">,<", "> <")
        return
    for part in filter(None, map(str.strip, uri.split(","))):
        path = unquote(urlparse(part).path) if part.startswith("file:") else part
        path = os.path.expanduser(os.path.expandvars(path))
        try:
            with open(path, encoding="utf-8") as file:
                yield f"CYCLONEDDS_URI: {path}", file.read()
        except OSError as exc:
            raise ConfigurationError(f"CYCLONEDDS_URI: {path}: {exc.strerror}") from exc


def _without_prologue(text: str) -> str:
    _, end, rest = text.partition("?>")
    return rest if end and text.lstrip().startswith("<?") else text


def _sections(element: ElementTree.Element, domain: int) -> Iterator[ElementTree.Element]:
    for child in element:
        tag = child.tag.rpartition("}")[2].lower()
        if tag == "cyclonedds" or (tag == "domain" and child.get("Id", "any") in ("any", "default", str(domain))):
            yield from _sections(child, domain)
        elif tag != "domain":
            child.tag = tag
            for each in child:
                each.tag = each.tag.rpartition("}")[2]
            yield child


_Asked = tuple[str, tuple[str, ...], str]
"""Interface, peers, and what the user's own configuration is."""

_domains: dict[int, tuple[Domain | None, _Asked, int]] = {}
"""By id: the domain (None if somebody else in this process made it), of what settings, and how many use it."""


def any_open() -> bool:
    return bool(_domains)


def open_domain(id: int, interface: str, peers: tuple[str, ...] = (), many: bool = False) -> None:
    with creating:
        asked = interface, peers, os.environ.get("CYCLONEDDS_URI", "")
        config = compose(settings(interface, id, peers, many), asked[2], id)
        domain, used, users = _domains.get(id, (None, asked, 0))
        if users == 0:
            keep_memory()
            note = note_on_sockets(_limit_of_sockets())
            if note:
                log.info("%s", note)
            domain = _new_domain(id, config, asked)
        elif used != asked:
            log.warning("domain %d is open in this process with other settings; they stay", id)
        _domains[id] = domain, used, users + 1


def _new_domain(id: int, config: str, asked: _Asked) -> Domain | None:
    before = set(_udp_sockets())
    try:
        domain = Domain(id, config)
    except DDSException as exc:
        if exc.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise _why(id, config, asked) from exc
    else:
        _keep_to_loopback({number: at for number, at in _udp_sockets().items() if number not in before})
        return domain
    log.warning("domain %d was opened by other code of this process; its settings apply to us, too", id)
    return None


def _keep_to_loopback(sockets: Mapping[int, str]) -> None:
    """If a domain uses the loopback interface alone, have its sockets hear nothing else.

    The library sends from the address of its interface, but listens at all of the host's: others would reach it. What
    it sends may go to other addresses of this host, where programs are with settings of their own.
    """
    everywhere = [number for number, address in sockets.items() if address == "0.0.0.0"]
    senders = [address for number, address in sockets.items() if number not in everywhere]
    if not senders or not all(address.startswith("127.") for address in senders):
        return  # it talks to others, by CYCLONEDDS_URI perhaps, which may name several interfaces
    for number in everywhere:
        if _libc.setsockopt(number, socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo", len(b"lo")):
            why = os.strerror(ctypes.get_errno())
            log.warning("DDS: other hosts may reach ports of this component, though it talks to none: %s", why)
            return


def _udp_sockets() -> dict[int, str]:
    """Those of this process for IPv4: the address where each listens, by its number. None where there is no /proc."""
    found = {}
    with contextlib.suppress(OSError):
        table = Path("/proc/self/net/udp").read_text().splitlines()[1:]
        addresses = {f"socket:[{words[9]}]": words[1] for words in map(str.split, table)}
        for number in os.listdir("/proc/self/fd"):
            with contextlib.suppress(OSError):  # closed by now
                if listening := addresses.get(os.readlink(f"/proc/self/fd/{number}")):
                    found[int(number)] = socket.inet_ntoa(struct.pack("=I", int(listening.partition(":")[0], 16)))
    return found


def _why(id: int, config: str, asked: _Asked) -> TransportError | ConfigurationError:
    """Why a domain could not be opened, and what to do about it."""
    interface, *_ = asked
    lines = _complaints(id, config)
    said = "; ".join(line.rstrip(".") for line in lines) or "Cyclone DDS says why on standard error"
    if any(line.startswith("config: ") for line in lines):
        said = re.sub(r" \(CYCLONEDDS_URI\+\d+ line \d+\)", "", said)  # counted in something that nobody has written
        return ConfigurationError(f"CYCLONEDDS_URI: {said.replace('config: //', '')}")
    remedy = ""
    if "participant index" in said:
        remedy = (
            "; too many processes of this host use it: take another `domain` for some of them, "
            "or allow for more by <Discovery><MaxAutoParticipantIndex> in CYCLONEDDS_URI"
        )
    elif interface and "available interface" in said:
        remedy = f"; there are {', '.join(name for _, name in socket.if_nameindex())}"
    return TransportError(f"dds: opening domain {id}: {said}{remedy}")


def _complaints(id: int, config: str) -> list[str]:
    """What the library says about a configuration it cannot use.

    It says that to standard error alone, and its return code is always the same; so it is asked once
    more, in a process whose standard error is ours.
    """
    code = "import sys; from cyclonedds.domain import Domain; Domain(int(sys.argv[1]), sys.argv[2])"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    call = [sys.executable, "-c", code, str(id), config]
    try:
        done = subprocess.run(
            call, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=30
        )
    except (OSError, subprocess.SubprocessError) as exc:
        log.debug("asking Cyclone DDS why: %s", exc)
        return []
    return re.findall(r"^[\d.]+ \[\d*\]\s+\S+: (.*\S)", done.stderr, re.MULTILINE)  # time [domain] thread: text


def close_domain(id: int) -> None:
    with creating:
        domain, config, users = _domains.pop(id)
        if users > 1:
            _domains[id] = domain, config, users - 1
        elif domain is not None:
            forget(domain)
