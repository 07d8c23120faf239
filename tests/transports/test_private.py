"""Who may read a private key: its owner, and for a key that root hands out, a group."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.errors import ConfigurationError
from robocomp_py.transports.private import excess, insist_private

ROOT, US, ANOTHER = 0, 1000, 1001


@pytest.mark.parametrize(("owner", "us"), [(US, US), (ROOT, ROOT), (US, ROOT), (ANOTHER, US)])
def test_only_its_owner_may_read_a_key(owner: int, us: int) -> None:
    assert not any(excess(mode, owner, us) for mode in (0o600, 0o400, 0o100600))
    assert all(excess(mode, owner, us) for mode in (0o640, 0o440, 0o620, 0o610, 0o604, 0o602, 0o601))


def test_a_key_that_is_roots_a_group_may_read_and_no_more() -> None:
    assert not any(excess(mode, ROOT, US) for mode in (0o640, 0o440, 0o600, 0o400, 0o100440))
    assert all(excess(mode, ROOT, US) for mode in (0o660, 0o650, 0o644, 0o642, 0o641))


def test_the_mode_that_a_file_may_have_is_reported(tmp_path: Path) -> None:
    key = tmp_path / "key.pem"
    key.touch()
    key.chmod(0o600)
    insist_private(key, "`key`")
    key.chmod(0o640)
    with pytest.raises(ConfigurationError, match=f"^`key`: {key} is open to other users; chmod 600 {key}$"):
        insist_private(key, "`key`")
