"""What the transport takes from Cyclone DDS beyond its public interface is there; what is missing is named."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.transports.dds import unsafe


@pytest.mark.parametrize("name", ["ddspy_write", "_entities", "_ref"])
def test_a_part_that_a_version_lacks_is_named(name: str) -> None:
    owner: Any = object()
    with pytest.raises(ImportError, match=rf"cyclonedds does not have `{name}`.*pip install 'cyclonedds~=11.0'"):
        unsafe._part(owner, name)


WITHOUT = """\
import sys
import cyclonedds.core
del cyclonedds.core.Entity._entities
try:
    import robocomp_py.transports.dds.unsafe
except ImportError as exc:
    print(exc)
"""


def test_another_version_of_the_library_is_refused_at_the_import() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, timeout=SOON * 6, check=True)
    assert "does not have `_entities`" in done.stdout


def test_a_missing_function_of_the_c_library_is_named() -> None:
    with pytest.raises(ImportError, match="`dds_no_such_function`"):
        unsafe._function("dds_no_such_function")


def test_a_closed_end_logs_nothing() -> None:
    assert unsafe.matched_subscriptions(0) == set()
    assert unsafe.matched_publications(0) == set()
    assert unsafe.take_endpoints(0, 1, print) == []
