from __future__ import annotations

from pathlib import Path

import pytest

from .planned import generate


@pytest.fixture(scope="package")
def components(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("network")
    generate(root)
    return root


@pytest.fixture
def folder(components: Path) -> Path:
    """Five generated components; a network of them is written here anew by each test."""
    return components
