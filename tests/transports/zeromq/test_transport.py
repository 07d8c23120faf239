"""ZeroMQ keeps the contract."""

import subprocess
import sys

from robocomp_py.testing.conformance import TransportConformance
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import Transport, TransportConfig
from robocomp_py.transports.zeromq.transport import ZeroMQTransport


class TestZeroMQ(TransportConformance):
    def open_transport(self) -> Transport:
        return ZeroMQTransport(TransportConfig(owner="test"))


TAKEN_APART = """
import atexit
atexit.register(lambda: garbage.__dict__.pop("getpid"))  # after pyzmq's own handler, which is registered later
import robocomp_py.transports.zeromq.transport
from zmq.utils import garbage
"""


def test_nothing_is_complained_of_while_the_interpreter_takes_its_modules_apart() -> None:
    done = subprocess.run([sys.executable, "-c", TAKEN_APART], capture_output=True, text=True, timeout=SOON * 6)
    assert (done.returncode, done.stderr) == (0, "")
