"""Configures DDS domains, and opens each of them once in a process."""

from __future__ import annotations

import contextlib
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


def settings(
    interface: str, domain: int = 0, peers: Sequence[str] = (), many: bool = False
) -> dict[tuple[str, str], str]:
    """Our configuration of a domain: XML elements by section and name.

    `interface` is a name, or an IPv4 address of this host; `peers` are addresses of hosts, instead of multicast;
    `many`: more than a few dozen processes use the domain.
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
        ("Tracing", "OutputFile"): "stderr",  # the default is a file in the working directory
    }
    if interface:
        kind = "address" if is_address(interface) else "name"
        found["General", "Interfaces"] = f"<NetworkInterface {kind}={quoteattr(interface)}/>"
    if many:
        # Each process has five internal writers, which send heartbeats until the last new reader has acknowledged
        # everything: by default ten times a second, which is more than many processes can answer. The price is that
        # the loss of a large message's last fragment, which a heartbeat reveals, is noticed later.
        found["Internal", "HeartbeatInterval"] = "500ms"
    if peers:
        found["General", "AllowMulticast"] = "false"
        found["Discovery", "MaxAutoParticipantIndex"] = "120"  # the number of ports probed at each peer
        # Never stop to probe a peer, so that it is found again after it was unreachable.
        probes = (f'<Peer Address={quoteattr(peer)} PruneDelay="inf"/>' for peer in peers)
        found["Discovery", "Peers"] = "".join(probes)
    if here:
        found["General", "FragmentSize"] = "63000B"
        found["Internal", "NackDelay"] = "10ms"  # losses here come from a full socket buffer: request at once
        found["Internal", "MaxQueuedRexmitBytes"] = "16MB"
        found["General", "AllowMulticast"] = "false"
        # A new participant probes all 250 possible addresses once, and the existing participants answer. The library
        # would repeat these probes every second for half a minute, which takes 0.2 % of a core.
        found["Discovery", "InitialLocatorPruneDelay"] = "2s"
        found["Discovery", "Peers"] = '<Peer Address="127.0.0.1"/>' + "".join(map(partial(_beacon, domain), _own()))
    return found


def _beacon(domain: int, address: str) -> str:
    """The address at which programs of this host with the library's default configuration discover peers.

    They expect multicast on a network interface. We send to that interface's own address, so our
    packets do not leave the host.
    """
    return f'<Peer Address="{address}:{7400 + 250 * domain}" PruneDelay="inf"/>'


def is_address(interface: str) -> bool:
    """Whether this is an IPv4 address, and not the name of an interface."""
    return re.fullmatch(r"\d{1,3}(\.\d{1,3}){3}", interface) is not None


def _own() -> list[str]:
    """The IPv4 addresses of this host; empty if they cannot be read."""
    try:
        names = [name for _, name in socket.if_nameindex()] if sys.platform == "linux" else []
    except OSError:
        return []
    return [address for address in map(address_of, names) if address]


def address_of(interface: str) -> str:
    """The IPv4 address of a network interface; "" if it has none."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            answer = fcntl.ioctl(asking, _SIOCGIFADDR, struct.pack("40s", interface.encode()[:15]))
    except OSError:
        return ""
    return socket.inet_ntoa(answer[20:24])


_SIOCGIFADDR = 0x8915


SMALL_BUFFER = 1_000_000
"""Minimum size, in bytes, of a socket's receive buffer for large messages."""


def note_on_sockets(limit: str) -> str:
    """A warning about this value of `net.core.rmem_max`; "" if it is large enough."""
    if not limit.isdecimal() or int(limit) >= SMALL_BUFFER:
        return ""
    return (
        f"dds: socket buffers of this host are limited to {int(limit) // 1000} KB, so parts of large messages may get "
        "lost and sent again when it is busy; to raise the limit: sysctl -w net.core.rmem_max=20000000"
    )


def _limit_of_sockets() -> str:
    try:
        with open("/proc/sys/net/core/rmem_max", encoding="ascii") as file:
            return file.read().strip()
    except OSError:  # not Linux, or not readable
        return ""


_NETWORK_SETTINGS = {("General", "Interfaces"), ("General", "AllowMulticast"), ("Discovery", "Peers")}
"""Settings that are left out if the user's configuration chooses other network interfaces."""


def compose(ours: Mapping[tuple[str, str], str], uri: str, domain: int) -> str:
    """Our configuration, followed by the user's (`CYCLONEDDS_URI`); the user's settings replace ours."""
    theirs = _elements(uri, domain)
    chosen = {("general", "interfaces"), ("general", "networkinterfaceaddress")} & theirs
    out = ElementTree.Element("CycloneDDS")
    inside = ElementTree.SubElement(out, "Domain", Id="any")
    sections: dict[str, ElementTree.Element] = {}
    for key, value in ours.items():
        section, name = key
        if (section.lower(), name.lower()) in theirs or (chosen and key in _NETWORK_SETTINGS):
            continue
        if section not in sections:
            sections[section] = ElementTree.SubElement(inside, section)
        whole = value if value.startswith(f"<{name}") else f"<{name}>{value}</{name}>"
        sections[section].append(ElementTree.fromstring(whole))
    text = ElementTree.tostring(out).decode()
    if not uri.isascii():
        raise ConfigurationError("CYCLONEDDS_URI: Cyclone DDS accepts ASCII only")
    return f"{text},{uri}" if uri.strip() else text


def _elements(uri: str, domain: int) -> set[tuple[str, str]]:
    """The elements that a configuration sets for this domain, as section and name, in lower case."""
    found: set[tuple[str, str]] = set()
    for where, text in _documents(uri):
        for section in _sections(_parsed(where, text), domain):
            found |= {(section.tag.lower(), element.tag.lower()) for element in section}
    return found


_ROOT = "<all>"
"""A configuration may have several root elements, which XML does not allow; so it is wrapped into one."""


def _parsed(where: str, text: str) -> ElementTree.Element:
    bare = _without_prologue(text)
    try:
        return ElementTree.fromstring(f"{_ROOT}{bare}</all>")
    except ElementTree.ParseError as exc:
        line, column = exc.position
        before = text[: len(text) - len(bare)]
        column += 1 - (len(_ROOT) if line == 1 else 0) + (len(before.rpartition("\n")[2]) if line == 1 else 0)
        line += before.count("\n")
        what = str(exc).partition(":")[0]
        raise ConfigurationError(f"{where}: not well-formed XML: {what} (line {line}, column {column})") from exc


def _documents(uri: str) -> Iterator[tuple[str, str]]:
    """The parts of a configuration, each with its place for messages."""
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


_Settings = tuple[str, tuple[str, ...], str]
"""Interface, peers, and the user's own configuration."""

_domains: dict[int, tuple[Domain | None, _Settings, int]] = {}
"""By id: the domain (None if other code of this process made it), its settings, and the number of its users."""


def any_open() -> bool:
    return bool(_domains)


def open_domain(id: int, interface: str, peers: tuple[str, ...], many: bool) -> None:
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
            log.warning("domain %d is already open in this process with other settings, which stay in force", id)
        _domains[id] = domain, used, users + 1


def _new_domain(id: int, config: str, asked: _Settings) -> Domain | None:
    before = set(_udp_sockets())
    try:
        domain = Domain(id, config)
    except DDSException as exc:
        if exc.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise _why(id, config, asked) from exc
    else:
        _keep_to_loopback({number: at for number, at in _udp_sockets().items() if number not in before})
        return domain
    log.warning("domain %d was opened by other code of this process; its settings apply to this transport, too", id)
    return None


def _keep_to_loopback(sockets: Mapping[int, str]) -> None:
    """If a domain uses the loopback interface only, bind its sockets to that interface.

    The library sends from the interface's address, but listens at all addresses of the host, so other hosts could
    reach it. Its packets may still go to other addresses of this host, for programs with other settings.
    """
    everywhere = [number for number, address in sockets.items() if address == "0.0.0.0"]
    senders = [address for number, address in sockets.items() if number not in everywhere]
    if not senders or not all(address.startswith("127.") for address in senders):
        return  # another interface is in use, perhaps by CYCLONEDDS_URI
    for number in everywhere:
        try:
            _bind_to_loopback(number)
        except OSError as exc:
            log.warning(
                "DDS: other hosts can reach ports of this component, which is meant for this host only: %s",
                exc.strerror,
            )
            return


def _bind_to_loopback(number: int) -> None:
    is_blocking = os.get_blocking(number)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM, fileno=os.dup(number)) as shared:
        os.set_blocking(number, is_blocking)  # Python changes it if the program has set a default timeout
        shared.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")


def _udp_sockets() -> dict[int, str]:
    """The IPv4 UDP sockets of this process: file descriptor to address."""
    found = {}
    with contextlib.suppress(OSError):
        table = Path("/proc/self/net/udp").read_text().splitlines()[1:]
        addresses = {f"socket:[{words[9]}]": words[1] for words in map(str.split, table)}
        for number in os.listdir("/proc/self/fd"):
            with contextlib.suppress(OSError):  # closed meanwhile
                if listening := addresses.get(os.readlink(f"/proc/self/fd/{number}")):
                    found[int(number)] = socket.inet_ntoa(struct.pack("=I", int(listening.partition(":")[0], 16)))
    return found


def _why(id: int, config: str, asked: _Settings) -> TransportError | ConfigurationError:
    """An exception that says why a domain could not be opened, and what to do about it."""
    interface, *_ = asked
    lines = _library_messages(id, config)
    reason = "; ".join(line.rstrip(".") for line in lines) or "Cyclone DDS reports the reason on standard error"
    if any(line.startswith("config: ") for line in lines):
        reason = re.sub(r" \(CYCLONEDDS_URI\+\d+ line \d+\)", "", reason)  # positions in generated text
        return ConfigurationError(f"CYCLONEDDS_URI: {reason.replace('config: //', '')}")
    remedy = ""
    if "participant index" in reason:
        remedy = (
            "; too many processes of this host use it: give some of them another `domain`, "
            "or allow more by <Discovery><MaxAutoParticipantIndex> in CYCLONEDDS_URI"
        )
    elif interface and "available interface" in reason:
        remedy = f"; available: {', '.join(name for _, name in socket.if_nameindex())}"
    return TransportError(f"dds: opening domain {id}: {reason}{remedy}")


def _library_messages(id: int, config: str) -> list[str]:
    """The library's messages about a configuration that it cannot use.

    The library writes them only to standard error, and always returns the same code. So we open the
    domain again in a child process and read its standard error.
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
