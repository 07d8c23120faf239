"""The agent of another host, as far as nobody else sees it."""

from __future__ import annotations

from pathlib import Path

from robocomp_py.deploy.agent import _tidy
from robocomp_py.deploy.sockets import listening


def test_who_ends_removes_nothing_of_an_agent_that_came_afterwards(tmp_path: Path):
    (tmp_path / "agent.log").touch()
    with listening(tmp_path / "agent"):
        _tidy(tmp_path / "agent")
    assert (tmp_path / "agent.log").exists()
    (tmp_path / "agent").unlink()
    _tidy(tmp_path / "agent")
    assert not tmp_path.exists()
