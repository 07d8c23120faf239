"""How damaged frames reach a component over each middleware: like frames of any program that may connect."""

from __future__ import annotations

import contextlib
import random
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from robocomp_py.errors import TransportError
from robocomp_py.testing.parts import blob, command, query
from robocomp_py.transports.base import Channel
from robocomp_py.wire.header import Flag, pack_publication, pack_reply, pack_request

from .noise import damaged

Send = Callable[[bytes], object]


def fuzz(transport: Any, middleware: str, channel: str, commands: str, seed: int, count: int) -> int:
    """Send so many, half of them to the server of `channel`, half to who takes `commands`; how many were sent."""
    sent = 0
    with contextlib.ExitStack() as undo:
        for number, target in enumerate((query(channel), command(commands))):
            for each in _SENDING[middleware](transport, target, seed + number, count // 2, undo):
                each()
                sent += 1
    return sent


def _good(transport: Any, channel: Channel) -> list[bytes]:
    """Headers of requests, replies and publications, and a payload behind each."""
    payload = blob(transport, b"hello|")
    body = payload[0] if isinstance(payload, list) else bytes(payload)
    fingerprint = channel.type.fingerprint
    heads = [
        pack_request(0, fingerprint, 1, 1, 5.0),
        pack_request(Flag.ONEWAY | Flag.SENT, fingerprint, 1, 2, 5.0),
        pack_request(Flag.IDEMPOTENT, fingerprint, 1, 3, None),
        pack_reply(0, 1, 1, 1),
        pack_publication(fingerprint, 1, 1, 1),
    ]
    return [head + body for head in heads]


def _zeromq(
    transport: Any, channel: Channel, seed: int, count: int, undo: contextlib.ExitStack
) -> Iterator[Callable[[], object]]:
    """As messages of ZeroMQ, and now and then as octets of its connections."""
    import zmq

    role = "serves" if channel.pattern == "query" else "receives"
    address = transport.directory.find(role, channel.name)[0][1].address
    context: zmq.Context[Any] = zmq.Context()
    dealer = context.socket(zmq.DEALER)
    dealer.linger = 10_000
    dealer.sndtimeo = 10_000
    undo.callback(context.term)
    undo.callback(dealer.close)
    dealer.connect(address)
    chance = random.Random(seed)
    name = channel.name.encode() + b"\0"
    for number, frame in enumerate(damaged(seed, count, [name + each for each in _good(transport, channel)])):
        if number % 1000 == 500:
            yield partial(_knock, address, frame)
        else:
            parts = [frame, *(chance.randbytes(9) for _ in range(number % 3))]
            yield partial(dealer.send_multipart, parts)
        if number % 5000 == 0:
            time.sleep(0.01)


def _knock(address: str, octets: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as connection, contextlib.suppress(OSError):
        connection.settimeout(5.0)
        connection.connect(address.removeprefix("ipc://"))
        connection.sendall(octets)


def _zenoh(
    transport: Any, channel: Channel, seed: int, count: int, undo: contextlib.ExitStack
) -> Iterator[Callable[[], object]]:
    """Half of a frame as the attachment, half as the payload; to the channel, to its links, and as a question."""
    import zenoh

    role = "serves" if channel.pattern == "query" else "receives"
    tokens = transport.table.find(role, channel.name)
    keys = [transport.key("rc", channel.name), *(transport.address("rc_to", token.link) for token in tokens)]
    keys += [transport.address("rc_ack", token.link) for token in tokens]
    chance = random.Random(seed)
    block = zenoh.CongestionControl.BLOCK
    for number, frame in enumerate(damaged(seed, count, _good(transport, channel))):
        key, at = chance.choice(keys), chance.choice((30, 34, 26, 33, len(frame)))
        if number % 100 == 50:
            yield partial(transport.session.get, key, payload=frame, attachment=frame, timeout=0.1)
        else:
            yield partial(transport.session.put, key, frame[at:], attachment=frame[:at], congestion_control=block)


def _dds(
    transport: Any, channel: Channel, seed: int, count: int, undo: contextlib.ExitStack
) -> Iterator[Callable[[], object]]:
    """As samples, and as packets to the ports where it listens."""

    def opened() -> Any:
        outlet = transport.caller(channel) if channel.pattern == "query" else transport.outlet(channel)
        undo.callback(outlet.close)
        if not outlet.wait_peer(10.0):
            raise TransportError(f"{channel.name}: nobody is there")
        return outlet

    outlet = opened()

    def write(sample: bytes) -> None:
        nonlocal outlet
        _, line = outlet.server(time.monotonic() + 10.0)
        try:
            if line.requests.write_within(bytearray(sample), time.monotonic() + 0.5, lambda: None):
                return
        except TransportError:  # the library refuses it here already
            return
        outlet.close()  # packets reach ourselves, too, and may have upset what keeps count for this writer
        outlet = opened()

    good = [bytes(4) + each for each in _good(transport, channel)]
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    undo.callback(udp.close)
    rtps = [b"RTPS\2\1\1\x10" + bytes(12) + b"\x15\1\x18\0" + bytes(20), b"RTPS\2\5\1\x10" + bytes(16)]
    packets = damaged(seed, count, rtps)
    ports = [7400 + 250 * domain + offset for domain in range(3) for offset in range(10, 30)]
    for number, frame in enumerate(damaged(seed, count, good)):
        if number % 4 == 0:
            yield partial(_sent, udp, next(packets), ports[number // 4 % len(ports)])
        else:
            sample = b"\0\1\0\0" + frame[4:] if number % 4 != 3 else frame
            yield partial(write, sample)


def _sent(udp: socket.socket, packet: bytes, port: int) -> None:
    with contextlib.suppress(OSError):
        udp.sendto(packet, ("127.0.0.1", port))


def _shm(
    transport: Any, channel: Channel, seed: int, count: int, undo: contextlib.ExitStack
) -> Iterator[Callable[[], object]]:
    """As messages in its queue: to that link, to others, to none, and with an unknown line for the reply."""
    from robocomp_py.transports.shm.queues import Sender, packed

    role = "serves" if channel.pattern == "query" else "receives"
    member, entry = transport.directory.find(role, channel.name)[0]
    sender = Sender(transport.node, packed(transport.member.id), member.id, 0)
    undo.callback(sender.close)
    chance = random.Random(seed)
    for frame in damaged(seed, count, _good(transport, channel)):
        to = chance.choice((int(entry.address), int(entry.address), 0, 77, 0xFFFFFFFF))
        line, at = chance.choice((0, 0, 1, 5000)), chance.choice((0, 26, 30, 34, 36))
        head, body = frame[: min(at, 36)], frame[at:]
        yield partial(_posted, sender, line, to, head, body)


def _posted(sender: Any, line: int, to: int, head: bytes, body: bytes) -> None:
    end = time.monotonic() + 10.0
    while not sender.send(line, to, head, body, len(body)):
        if time.monotonic() > end:
            raise TransportError("it does not take messages any more")
        time.sleep(0.0005)


def _ice(
    transport: Any, channel: Channel, seed: int, count: int, undo: contextlib.ExitStack
) -> Iterator[Callable[[], object]]:
    """As requests with half of a frame as the context, half as what is asked; and as octets of its connections."""
    import Ice

    from robocomp_py.transports.ice.messages import RC, RC_MAX

    role = "serves" if channel.pattern == "query" else "receives"
    address = transport.directory.find(role, channel.name)[0][1].address.partition(" ")[2]
    proxy = transport.communicator.stringToProxy(address).ice_invocationTimeout(10_000)
    endpoint = proxy.ice_getEndpoints()[0].getInfo()
    operation = channel.name.rpartition("/")[2]
    chance = random.Random(seed)
    good = _good(transport, channel)
    header = len(good[0]) - len(blob(transport, b"hello|"))
    messages = [
        b"IceP\1\0\1\0" + bytes([kind, 0]) + (14 + len(each)).to_bytes(4, "little") + each
        for kind in range(5)
        for each in good
    ]
    packets = damaged(seed, count, messages)
    for number, frame in enumerate(damaged(seed, count, good)):
        if number % 100 == 50:
            yield lambda: _poured(endpoint.host, endpoint.port, next(packets))
            continue
        at = chance.choice((header, header, 0, len(frame)))
        told = {RC: frame[:at].hex() if number % 10 else chance.choice(("", "rc", "\U0001f916", "0" * 10_000))}
        if number % 7 == 0:
            told[RC_MAX] = chance.choice(("", "-1", "0", "9" * 30, "\N{SUPERSCRIPT TWO}", "100"))
        mode = chance.choice((Ice.OperationMode.Normal, Ice.OperationMode.Idempotent, Ice.OperationMode.Nonmutating))
        way = proxy if number % 3 else proxy.ice_oneway()
        yield partial(_invoked, way, operation, mode, frame[at:], told)


def _invoked(proxy: Any, operation: str, mode: Any, body: bytes, told: dict[str, str]) -> None:
    import Ice

    with contextlib.suppress(Ice.Exception):  # also what Ice sends to no servant
        proxy.ice_invoke(operation, mode, body, told)


def _poured(host: str, port: int, octets: bytes) -> None:
    with socket.create_connection((host, port), 5.0) as connection, contextlib.suppress(OSError):
        connection.sendall(octets)


_SENDING: dict[str, Callable[..., Iterator[Callable[[], object]]]] = {
    "zeromq": _zeromq,
    "zenoh": _zenoh,
    "dds": _dds,
    "shm": _shm,
    "ice": _ice,
}
