"""rospy, of ROS 1: a service with a connection that stays, and a pair of topics. On the Python of the system.

Octets are `bytes` there, which rospy passes on as they are. Without Nagle's algorithm, and with buffers
that hold a whole message, as its documentation advises. The master runs in the far process, and has
nothing to do after both have met. With `queue_size` a publisher hands each message to a thread of its
own; without, the default of `Publisher`, `publish` itself writes to the connection, which is quicker here.
"""

from __future__ import annotations

import os
import time
import warnings
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import rospy
from rosmaster.master import Master
from std_msgs.msg import UInt8MultiArray

from .driver import Array, drive, main, until_told

_BUFFER = 16_000_000
_PATIENCE = 10.0


class Echo:
    """A service, as `genpy` would generate it of a file with this message on both sides."""

    _type = "benchmarks/Echo"
    _md5sum = UInt8MultiArray._md5sum
    _request_class = UInt8MultiArray
    _response_class = UInt8MultiArray


def far(folder: str, port: str) -> None:
    _configure(folder, port)
    master = Master(int(port))
    master.start()
    try:
        rospy.init_node("far", disable_signals=True)
        pong = _publisher("pong")
        _subscribe("ping", lambda message: pong.publish(_encode(_decode(message))))
        rospy.Service("echo", Echo, lambda message: _encode(_decode(message)), buff_size=_BUFFER)
        until_told()
    finally:
        rospy.signal_shutdown("done")
        master.stop()


def near(folder: str, port: str, by: str) -> None:
    _configure(folder, port)
    rospy.init_node("near", disable_signals=True)
    try:
        drive(_by_service() if by == "service" else _by_topics(), folder)
    finally:
        rospy.signal_shutdown("done")


def _by_service() -> Any:
    rospy.wait_for_service("echo", _PATIENCE)
    echo = rospy.ServiceProxy("echo", Echo, persistent=True)
    return lambda data: _decode(echo(_encode(data)))


def _by_topics() -> Any:
    answers: SimpleQueue[Any] = SimpleQueue()
    ping = _publisher("ping")
    _subscribe("pong", answers.put)
    end = time.monotonic() + _PATIENCE
    while True:  # until both topics have found their readers
        ping.publish(_encode(np.zeros(1, np.uint8)))
        try:
            answers.get(timeout=0.2)
            break
        except Empty:
            if time.monotonic() > end:
                raise TimeoutError("the far end did not come") from None

    def ask(data: Array) -> Array:
        ping.publish(_encode(data))
        return _decode(answers.get(timeout=_PATIENCE))

    return ask


def _publisher(topic: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that `queue_size` was not given
        return rospy.Publisher(topic, UInt8MultiArray, tcp_nodelay=True)


def _subscribe(topic: str, callback: Any) -> None:
    rospy.Subscriber(topic, UInt8MultiArray, callback, buff_size=_BUFFER, tcp_nodelay=True)


def _encode(data: Array) -> Any:
    return UInt8MultiArray(data=data.tobytes())


def _decode(message: Any) -> Array:
    return np.frombuffer(message.data, np.uint8)


def _configure(folder: str, port: str) -> None:
    os.environ |= {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1", "ROS_HOME": folder}


if __name__ == "__main__":
    main(far=far, near=near)
