"""What the tests with Ice's own programs share."""

from __future__ import annotations

import pytest

from tests import freeports


@pytest.fixture
def free_port() -> int:
    return freeports.free_port()
