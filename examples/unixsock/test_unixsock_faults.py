import tempfile
from collections.abc import Iterator

import pytest
from unixsock import UnixSocketTransport

from robocomp_py.testing.faults import TransportFaults
from robocomp_py.transports.base import Transport, TransportConfig


@pytest.fixture(autouse=True, scope="module")
def own_folder() -> Iterator[None]:
    """Nothing else writes to the run-time folder while it is examined."""
    with tempfile.TemporaryDirectory(prefix="rc-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROBOCOMP_RUNTIME_DIR", folder)
        yield


class TestUnixSocketFaults(TransportFaults):
    def open_transport(self) -> Transport:
        return UnixSocketTransport(TransportConfig(owner="test"))
