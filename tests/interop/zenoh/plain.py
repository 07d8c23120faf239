"""Talks to components over Zenoh as docs/reference/protocol-zenoh.md says, with Zenoh's library and nothing of ours.

    plain.py ENDPOINT hear CHANNEL                            one message of a topic
    plain.py ENDPOINT ask CHANNEL FINGERPRINT A B             a / b, and what remains
    plain.py ENDPOINT publish CHANNEL FINGERPRINT NUMBER TEXT one message, until it was taken
    plain.py ENDPOINT serve CHANNEL FINGERPRINT               answers one question

A message of the topic is a number (int) and a text (string); the query takes two `long` and answers two.
"""

import json
import os
import secrets
import struct
import sys
import time

import zenoh

XCDR1 = b"\0\1\0\0"
REQUEST, REPLY, PUBLICATION = struct.Struct("<BBQQQI"), struct.Struct("<BBQQQ"), struct.Struct("<BQQQq")
BLOCK = zenoh.CongestionControl.BLOCK
PATIENCE = 10.0

ME = secrets.randbits(40) << 24 | 1


def address(kind, link):
    return f"{kind}/0/{link >> 24:010x}/{link & 0xFFFFFF:06x}"


def token(session, role, traits, fingerprint, channel):
    key = f"rc_lv/0/{role}/{traits}/{fingerprint:016x}/{os.getpid()}/{ME:016x}/{channel}"
    return session.liveliness().declare_token(key)


def hear(session, channel):
    sample = session.declare_subscriber(f"rc/0/{channel}").recv()
    _, _, _, sequence, _ = PUBLICATION.unpack(sample.attachment.to_bytes())
    number, length = struct.unpack_from("<4xiI", sample.payload.to_bytes())
    text = sample.payload.to_bytes()[12 : 12 + length - 1].decode()
    print(f"heard message {sequence}: {number}, {text}")


def ask(session, channel, fingerprint, a, b):
    header = REQUEST.pack(1, 0, int(fingerprint, 16), ME, 1, int(PATIENCE * 1000))
    question = XCDR1 + struct.pack("<qq", int(a), int(b))
    replies = session.get(
        f"rc/0/{channel}",
        payload=question,
        attachment=header,
        timeout=PATIENCE,
        consolidation=zenoh.ConsolidationMode.NONE,
    )
    for reply in replies:
        if reply.ok:
            _, status, client, sequence, _ = REPLY.unpack(reply.ok.attachment.to_bytes())
            assert (client, sequence) == (ME, 1)
            print(f"status {status}", *struct.unpack_from("<4xqq", reply.ok.payload.to_bytes()))
            return
    print("no answer")


def publish(session, channel, fingerprint, number, text):
    taken = session.declare_subscriber(address("rc_ack", ME))
    there = token(session, "publishes", "r", int(fingerprint, 16), channel)
    publisher = session.declare_publisher(f"rc/0/{channel}", congestion_control=BLOCK)
    while not publisher.matching_status.matching:
        time.sleep(0.01)
    octets = text.encode() + b"\0"
    payload = XCDR1 + struct.pack("<iI", int(number), len(octets)) + octets
    publisher.put(payload, attachment=PUBLICATION.pack(1, int(fingerprint, 16), ME, 1, time.time_ns()))
    by, sequence = struct.unpack("<QQ", taken.recv().payload.to_bytes())
    print(f"message {sequence} was taken by {by:016x}")
    there.undeclare()


def serve(session, channel, fingerprint):
    questions = session.declare_subscriber(address("rc_to", ME))
    there = token(session, "serves", "-", int(fingerprint, 16), channel)
    question = questions.recv()
    _, _, _, client, sequence, _ = REQUEST.unpack(question.attachment.to_bytes())
    a, b = struct.unpack_from("<4xqq", question.payload.to_bytes())
    header = REPLY.pack(1, 0, client, sequence, ME)
    session.put(
        address("rc_to", client),
        XCDR1 + struct.pack("<qq", *divmod(a, b)),
        attachment=header,
        congestion_control=BLOCK,
    )
    print(f"answered {a} / {b}")
    sys.stdin.read()  # until it has arrived, since our token goes with us
    there.undeclare()


endpoint, what, *arguments = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
with zenoh.open(config) as session:
    {"hear": hear, "ask": ask, "publish": publish, "serve": serve}[what](session, *arguments)
print("modules of ours:", *(name for name in sys.modules if name.startswith("robocomp_py.")))
