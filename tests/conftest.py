"""What all tests share: a run-time folder of their own, and no leftovers in it."""

from __future__ import annotations

import gc
import os
import signal
import tempfile
import tomllib
from collections.abc import Generator, Iterator
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from .leftovers import pytest_runtest_call as pytest_runtest_call
from .leftovers import pytest_runtest_teardown as pytest_runtest_teardown
from .remembered import remember

# How long an example takes is decided by what else runs on the machine.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")

remember()

os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", "/tmp")  # of `tmp_path`, also if TMPDIR is long: sockets are in there

for each in (signal.SIGINT, signal.SIGHUP):  # `pytest &` and nohup ignore them, and so would all that tests start
    if signal.getsignal(each) is signal.SIG_IGN:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)


def pytest_configure() -> None:
    """Fail at once if entry points were added since this package was installed: nothing would find them."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for group, named in project["entry-points"].items():
        if lacking := set(named) - entry_points(group=group).names:
            found = ", ".join(sorted(lacking))
            raise pytest.UsageError(
                f"pyproject.toml has entry points of {group} that are not installed ({found}); "
                "run: .venv/bin/pip install --no-deps --editable ."
            )


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect no garbage while tests are collected: there is little, and looking for it is a fifth of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """Leave out of garbage collections what is there now: hundreds of thousands of objects, which stay to the end.

    Otherwise, each collection takes half a second, and so does the end of a component that asks for one.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True, scope="session")
def runtime_folder() -> Iterator[Path]:
    """Tests neither meet components that run on this machine, nor leave files behind."""
    before = os.environ.get("ROBOCOMP_RUNTIME_DIR")
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:  # short: socket paths have 107 bytes
        os.environ["ROBOCOMP_RUNTIME_DIR"] = folder
        yield Path(folder)
    if before is None:
        del os.environ["ROBOCOMP_RUNTIME_DIR"]
    else:
        os.environ["ROBOCOMP_RUNTIME_DIR"] = before


@pytest.fixture(autouse=True, scope="session")
def dds_of_this_worker(runtime_folder: Path) -> Iterator[None]:
    """Over DDS, tests meet no components of tests that other workers run at the same time."""
    with pytest.MonkeyPatch.context() as environment:
        if "PYTEST_XDIST_WORKER" in os.environ:  # alone, tests also meet programs that know no tag
            environment.setenv("CYCLONEDDS_URI", f"<Discovery><Tag>{runtime_folder.name}</Tag></Discovery>")
        yield


@pytest.fixture(autouse=True, scope="session")
def children_without_plug_ins() -> Iterator[None]:
    """Where a test starts pytest, the plug-ins of this environment would take longer to load than it runs."""
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
        yield


@pytest.fixture
def own_runtime_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """One for a single test, where nothing can be that another one has left, or has failed to end."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as folder:
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", folder)
        yield Path(folder)
