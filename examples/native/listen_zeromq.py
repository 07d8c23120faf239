"""Hears and asks a sonar over ZeroMQ."""

import json
import os
import secrets
import struct
from pathlib import Path

import msgpack
import zmq

LIST = json.loads(Path("sonar/generic/zeromq/channels.json").read_text())
FINGERPRINTS = {each["channel"]: int(each["fingerprint"], 16) for each in LIST["channels"]}
CLIENT = secrets.randbits(64)
REPLY, PUBLICATION = "<BBQQQ", "<BQQQq"
context = zmq.Context()


def address(role, channel):
    for file in Path(os.environ["ROBOCOMP_RUNTIME_DIR"], "zeromq").glob("*.json"):
        for entry in json.loads(file.read_text())["entries"]:
            if (entry["role"], entry["channel"]) == (role, channel):
                return entry["address"]
    raise SystemExit(f"no component {role} {channel}")


def ask(socket, channel, number, *arguments):
    header = struct.pack("<BBQQQI", 1, 0, FINGERPRINTS[channel], CLIENT, number, 5000)
    socket.send(channel.encode() + b"\0" + header + msgpack.packb(arguments))
    reply = socket.recv()
    _, status, _, _, _ = struct.unpack_from(REPLY, reply)
    return status, msgpack.unpackb(reply[struct.calcsize(REPLY) :])


topic = context.socket(zmq.SUB)
topic.subscribe(b"sonar/SonarPub/nearest\0")
topic.connect(address("publishes", "sonar/SonarPub/nearest"))
_, message = topic.recv().split(b"\0", 1)
[[distance, quality, heard]] = msgpack.unpackb(message[struct.calcsize(PUBLICATION) :])
print(f"heard {distance:.1f} m, quality {quality}")

server = context.socket(zmq.DEALER)
server.connect(address("serves", "sonar/Sonar/scan"))
status, [echoes] = ask(server, "sonar/Sonar/scan", 1, [0.0, 0.5])
print(f"scanned {[round(distance, 2) for distance, quality, heard in echoes]}")
status, [exception, limit] = ask(server, "sonar/Sonar/scan", 2, [2.0])
print(f"status {status}: {exception}, {limit}")
context.destroy(linger=0)
