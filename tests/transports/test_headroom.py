"""Before a limit of the system is reached, a component says which one, and what to raise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.transports import headroom
from robocomp_py.transports.headroom import Limit

OPENING = """
import logging, os, resource, sys
from robocomp_py.transports import headroom
logging.basicConfig(format="%(message)s", stream=sys.stdout)
soft, hard, *opened = map(int, sys.argv[1:])
resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
for number in opened:
    while len(os.listdir("/dev/fd")) - 1 < number:
        os.open("/dev/null", 0)
    headroom.check("arm")
    print("at", number)
"""


def told(*arguments: int) -> list[str]:
    """What a process with so many descriptors says: in a process of its own, since they are told once."""
    command = [sys.executable, "-c", OPENING, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON * 3).stdout.splitlines()


def test_descriptors_are_told_once_at_four_fifths_of_the_limit() -> None:
    assert told(100, 4096, 79, 80, 90) == [
        "at 79",
        "arm: 80 of 100 file descriptors are in use. At the limit, no further peer can connect. "
        "Raise it: ulimit -n 4096",
        "at 80",
        "at 90",
    ]


@pytest.mark.parametrize(
    ("hard", "remedy"),
    [
        (150, "ulimit -n 150"),
        (100, "ulimit -n 4096 (as root, since the hard limit is reached; for good, `nofile` in "),
    ],
)
def test_the_remedy_fits_the_hard_limit(hard: int, remedy: str) -> None:
    assert f"Raise it: {remedy}" in told(100, hard, 80)[0]


TRANSPORT = """
import logging, sys
from pathlib import Path
from robocomp_py.testing.conformance import topic
from robocomp_py.transports import headroom
from robocomp_py.transports.base import TransportConfig
from robocomp_py.transports.zeromq.transport import ZeroMQTransport
logging.basicConfig(format="%(message)s", stream=sys.stdout)
headroom._INOTIFY = Path(sys.argv[1])
transport = ZeroMQTransport(TransportConfig())
inlet = transport.inlet(topic("a/b/c"), print)
inlet.wait_peer(0.0)
headroom.check("")
transport.close()
"""


def test_watches_and_instances_of_inotify_are_told(own_runtime_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "max_user_watches").write_text("2\n")
    (tmp_path / "max_user_instances").write_text("1\n")
    command = [sys.executable, "-c", TRANSPORT, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON * 3)
    watches, instances = done.stdout.splitlines()
    assert watches.startswith("component: ")
    assert watches.endswith("Raise it: sysctl fs.inotify.max_user_watches=1024")
    assert "1 of 1 inotify instances are in use" in instances
    assert instances.endswith("Raise it: sysctl fs.inotify.max_user_instances=1024")


def test_a_limit_is_near_from_four_fifths_on() -> None:
    near = [used for used in range(1, 11) if Limit("", used, 10, "", "").is_near]
    assert near == [8, 9, 10]


def test_a_process_without_transports_makes_no_run_time_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", str(tmp_path / "none"))
    monkeypatch.setattr(headroom, "_watches", lambda: 0)
    headroom.check("arm")
    assert not (tmp_path / "none").exists()
