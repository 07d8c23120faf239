"""Transport `unixsock` on several hosts: what it declares to `rcdeploy`, and the relay that runs on each of them.

A relay copies entries of the directories of other hosts into that of its own. Behind each copy is a Unix socket of the
relay; what connects there is connected to the original over TCP. So components know of no other host.

    relay → relay    a line of JSON: {} asks for entries, which come in lines whenever they change
                     {"path": …} asks for a connection to that socket; from then on bytes go both ways

In a network with keys, relays speak TLS, and only with relays of the same network. Of the channels, they pass on those
that the network connects.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import ssl
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from robocomp_py.errors import TransportError
from robocomp_py.transports.deployment import Deployment, Reached
from robocomp_py.transports.directory import Directory
from robocomp_py.transports.members import Entry, Member, member_of, told_of
from robocomp_py.transports.membership import Membership
from robocomp_py.transports.network import Helper, Network, Wiring
from robocomp_py.transports.permissions import Graph
from robocomp_py.transports.runtime_folder import runtime_dir

log = logging.getLogger("robocomp.transport.unixsock")

ROLES = "publishes", "subscribes", "commands", "receives", "calls", "serves"

TICK, ALIVE = 0.1, 1.0
"""Seconds between two looks at the directory, and between two lines that say that a relay is there."""

PATIENCE = 5.0
"""Seconds without a line after which a relay is given up."""

LONGEST = 1 << 24
"""Bytes of a line."""

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class UnixSocketDeployment(Deployment):
    summary = "Unix sockets, relayed between hosts"
    crosses_hosts = True
    unprotected = ""  # only this user can enter the run-time folder, and relays need certificates
    shares = False
    modules = (("unixsock", "robocomp-unixsock"),)

    def wire(self, network: Network) -> Wiring:
        crossing, port = network.crossing(), network.helper_port
        hosts = network.hosts(crossing)

        def relay(host: str) -> Helper:
            options = {
                "listen": network.endpoint(host, port),
                "peers": [network.endpoint(other, port) for other in hosts if other != host],
                "channels": sorted({way.channel for way in crossing if host in network.hosts([way])}),
            }
            where = (network.addresses[host],)
            return Helper(network.middleware, host, {"relay": options}, "unixsock-relay", "Unix sockets", where)

        return Wiring(helpers=tuple(map(relay, hosts)))

    def reached(self, options: Mapping[str, Any]) -> Iterator[Reached]:
        if relay := options.get("relay"):
            yield Reached("is relayed at", f"tcp://{relay['listen']}")

    def secured(self, helper: Helper, graph: Graph, folder: Path, numbers: Mapping[str, int]) -> Mapping[str, Any]:
        keys = {name: f"{folder}/{name}.pem" for name in ("ca", "certificate", "key")}
        return {"relay": {**helper.options["relay"], **keys}}


@contextlib.contextmanager
def relaying(options: Mapping[str, Any]) -> Iterator[None]:
    """While this is entered, the relay runs. Raises TransportError."""
    started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()
    thread = threading.Thread(target=asyncio.run, args=[_Relay(options).run(started)], name="unixsock-relay")
    thread.start()
    try:
        loop, stop = started.result()
        try:
            yield
        finally:
            loop.call_soon_threadsafe(stop.set)
    except OSError as exc:
        raise TransportError(f"unixsock: the relay cannot listen at {options['listen']}: {exc}") from exc
    finally:
        thread.join()


@dataclass
class _Copy:
    """A member of another host in our directory."""

    membership: Membership
    entries: dict[Entry, Entry] = field(default_factory=dict)
    """Those of the original, and ours."""
    sockets: dict[str, tuple[str, asyncio.Server]] = field(default_factory=dict)
    """By path there, the one here."""

    def close(self) -> None:
        for _, server in self.sockets.values():
            server.close()
        self.membership.close()


class _Relay:
    def __init__(self, options: Mapping[str, Any]) -> None:
        self._options = options
        self._directory = Directory(runtime_dir("unixsock"))
        self._copies: dict[tuple[str, str], _Copy] = {}
        """By other relay, and member there."""

    async def run(self, started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]]) -> None:
        stop = asyncio.Event()
        host, port = _address(self._options["listen"])
        try:
            server = await asyncio.start_server(self._serve, host, port, ssl=self._tls(ssl.Purpose.CLIENT_AUTH))
        except OSError as exc:
            started.set_exception(exc)
            return
        started.set_result((asyncio.get_running_loop(), stop))
        tasks = [asyncio.create_task(self._follow(peer)) for peer in self._options["peers"]]
        await stop.wait()
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*tasks, *others, return_exceptions=True)

    # What others get.

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, ValueError, TimeoutError, asyncio.IncompleteReadError):  # it has gone
            async with _closing(writer):
                if not self._admits(writer):
                    return
                async with asyncio.timeout(PATIENCE):
                    asked = json.loads(await reader.readuntil())
                if path := asked.get("path"):
                    if any(path == _path(entry) for each in self._members() for entry in each.entries):
                        await _join((reader, writer), await asyncio.open_unix_connection(path))
                else:
                    await self._tell(writer)

    async def _tell(self, writer: asyncio.StreamWriter) -> None:
        told, waited = "", 0.0
        while True:
            text = json.dumps([_told(each) for each in self._members()])
            if text != told or waited >= ALIVE:
                writer.write(f"{text}\n".encode())
                async with asyncio.timeout(PATIENCE):
                    await writer.drain()
                told, waited = text, 0.0
            await asyncio.sleep(TICK)
            waited += TICK

    def _members(self) -> list[Member]:
        """Those of this host, with what they have of the channels that the network connects."""
        found: dict[str, Member] = {}
        for role in ROLES:
            for channel in self._options["channels"]:
                for member, entry in self._directory.find(role, channel):
                    known = found.setdefault(member.id, replace(member, entries=()))
                    if entry not in known.entries:
                        found[member.id] = replace(known, entries=(*known.entries, entry))
        ours = {each.membership.id for each in self._copies.values()}
        return [each for each in found.values() if each.id not in ours and self._directory.alive(each.id)]

    # What we get from others.

    async def _follow(self, peer: str) -> None:
        while True:
            try:
                reader, writer = await self._connect(peer)
                async with _closing(writer):
                    writer.write(b"{}\n")
                    while True:
                        async with asyncio.timeout(PATIENCE):
                            told = json.loads(await reader.readuntil())
                        await self._copy(peer, {each["id"]: member_of(each, each["id"]) for each in told})
            except (OSError, ValueError, TypeError, KeyError, TimeoutError, asyncio.IncompleteReadError) as exc:
                log.debug("the relay at %s: %r", peer, exc)
            finally:
                await self._copy(peer, {})
            await asyncio.sleep(TICK)

    async def _copy(self, peer: str, members: Mapping[str, Member]) -> None:
        for key in [key for key in self._copies if key[0] == peer and key[1] not in members]:
            self._copies.pop(key).close()
        for member in members.values():
            copy = self._copies.get((peer, member.id))
            if not copy:
                copy = self._copies[peer, member.id] = _Copy(self._directory.join(member.owner))
            for entry in copy.entries.keys() - set(member.entries):
                copy.membership.remove(copy.entries.pop(entry))
            for entry in member.entries:
                if entry not in copy.entries:
                    ours = replace(entry, address=await self._here(peer, copy, entry))
                    copy.membership.add(ours)
                    copy.entries[entry] = ours

    async def _here(self, peer: str, copy: _Copy, entry: Entry) -> str:
        """The address of an entry, with a socket of ours instead of the one there."""
        path = _path(entry)
        if not path:
            return ""
        if path not in copy.sockets:
            here = str(copy.membership.address(str(len(copy.sockets))))
            copy.sockets[path] = here, await asyncio.start_unix_server(partial(self._pass_on, peer, path), here)
        return entry.address.replace(path, copy.sockets[path][0])

    async def _pass_on(self, peer: str, path: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, TimeoutError):  # an end has gone
            async with _closing(writer):
                there = await self._connect(peer)
                there[1].write(json.dumps({"path": path}).encode() + b"\n")
                await _join((reader, writer), there)

    # How it is protected.

    async def _connect(self, peer: str) -> Streams:
        host, port = _address(peer)
        tls = self._tls(ssl.Purpose.SERVER_AUTH)
        async with asyncio.timeout(
            PATIENCE
        ):  # not `wait_for`: in Python 3.11 it can swallow the cancellation at the end
            reader, writer = await asyncio.open_connection(host, port, ssl=tls, limit=LONGEST)
        if not self._admits(writer):
            writer.close()
            raise ConnectionRefusedError(f"{peer} is not a relay of this network")
        return reader, writer

    def _tls(self, purpose: ssl.Purpose) -> ssl.SSLContext | None:
        if "key" not in self._options:
            return None
        context = ssl.create_default_context(purpose, cafile=self._options["ca"])
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_cert_chain(self._options["certificate"], self._options["key"])
        return context

    def _admits(self, writer: asyncio.StreamWriter) -> bool:
        """Whether the other side is a relay: its certificate is of the network's authority, and names one."""
        if "key" not in self._options:
            return True
        certificate = writer.get_extra_info("peercert") or {}
        names = [value for part in certificate.get("subject", ()) for key, value in part if key == "commonName"]
        return any(name.startswith("router@") for name in names)


@contextlib.asynccontextmanager
async def _closing(writer: asyncio.StreamWriter) -> Any:
    try:
        yield
    finally:
        writer.close()


async def _join(one: Streams, other: Streams) -> None:
    """Pass bytes on in both directions until either side ends."""
    async with _closing(other[1]):
        pumps = [asyncio.create_task(_pump(one[0], other[1])), asyncio.create_task(_pump(other[0], one[1]))]
        try:
            await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for pump in pumps:
                pump.cancel()


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):  # either side has gone
        while data := await reader.read(1 << 16):
            writer.write(data)
            await writer.drain()


def _address(endpoint: str) -> tuple[str, int]:
    host, _, port = endpoint.rpartition(":")
    return host.strip("[]"), int(port)


def _path(entry: Entry) -> str:
    """The socket in an address."""
    return entry.address.rpartition(" ")[2]


def _told(member: Member) -> dict[str, Any]:
    entries = [told_of(entry) for entry in member.entries]
    return {"id": member.id, "owner": member.owner, "pid": member.pid, "entries": entries}
