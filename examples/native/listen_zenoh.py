"""Hears and asks a sonar over Zenoh."""

import json
import os
import secrets
import struct
from pathlib import Path

import zenoh

LIST = json.loads(Path("sonar/generic/zenoh/channels.json").read_text())
KEYS = {each["channel"]: each["messages"][0]["key"] for each in LIST["channels"]}
FINGERPRINTS = {each["channel"]: int(each["fingerprint"], 16) for each in LIST["channels"]}
CLIENT = secrets.randbits(64)
CDR = b"\0\1\0\0"

config = zenoh.Config()
config.insert_json5("mode", '"client"')
router = f"unixsock-stream/{os.environ['ROBOCOMP_RUNTIME_DIR']}/zenoh/router.sock"
config.insert_json5("connect/endpoints", json.dumps([router]))


def ask(session, channel, number, payload):
    header = struct.pack("<BBQQQI", 1, 0, FINGERPRINTS[channel], CLIENT, number, 5000)
    for reply in session.get(KEYS[channel], payload=payload, attachment=header, timeout=5.0):
        if reply.ok:
            _, status, _, _, _ = struct.unpack("<BBQQQ", reply.ok.attachment.to_bytes())
            return status, reply.ok.payload.to_bytes()
    raise SystemExit(f"no server of {channel}")


with zenoh.open(config) as session:
    topic = session.declare_subscriber(KEYS["sonar/SonarPub/nearest"])
    distance, quality, sec, nanosec = struct.unpack("<4xfiiI", topic.recv().payload.to_bytes())
    print(f"heard {distance:.1f} m, quality {quality}")

    angles = CDR + struct.pack("<I2f", 2, 0.0, 0.5)
    status, payload = ask(session, "sonar/Sonar/scan", 1, angles)
    echoes = struct.iter_unpack("<fiiI", payload[8:])  # behind CDR and the number of echoes
    print(f"scanned {[round(distance, 2) for distance, quality, sec, nanosec in echoes]}")

    status, payload = ask(session, "sonar/Sonar/scan", 2, CDR + struct.pack("<If", 1, 2.0))
    (length,) = struct.unpack_from("<4xI", payload)
    name = payload[8 : 8 + length - 1].decode()
    (limit,) = struct.unpack_from("<f", payload, 8 + length + -length % 4)
    print(f"status {status}: {name}, {limit}")
