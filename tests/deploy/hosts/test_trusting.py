"""Which keys hosts have."""

from __future__ import annotations

import stat
from pathlib import Path

import asyncssh
import pytest

from robocomp_py.deploy.hosts.trusting import Presented, host_of, known_keys, own_file, remember, user_file
from robocomp_py.errors import DeploymentError


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)


def key() -> str:
    made = asyncssh.generate_private_key("ssh-ed25519").export_public_key("openssh")
    return " ".join(made.decode().split()[:2])


def keys_of(host: str, port: int = 22) -> list[str]:
    return [" ".join(each.export_public_key("openssh").decode().split()[:2]) for each in known_keys(host, "", port)[0]]


def test_a_host_is_known_once_it_is_remembered():
    shown = key()
    remember(Presented("robot", 22, shown, ""))
    assert keys_of("robot") == [shown]
    assert keys_of("base") == []


def test_a_host_has_one_key_the_latest():
    remember(Presented("robot", 22, key(), ""))
    remember(Presented("base", 22, key(), ""))
    remember(Presented("robot", 22, latest := key(), ""))
    assert keys_of("robot") == [latest]
    assert len(own_file().read_text().splitlines()) == 2


def test_the_file_is_its_users_alone():
    path = remember(Presented("robot", 22, key(), ""))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_hosts_at_other_ports_are_others():
    remember(Presented("robot", 22, at_22 := key(), ""))
    remember(Presented("robot", 2222, at_2222 := key(), ""))
    assert (keys_of("robot"), keys_of("robot", 2222)) == ([at_22], [at_2222])


def test_hosts_known_to_the_users_ssh_are_known():
    user_file().parent.mkdir()
    user_file().write_text(f"robot {(theirs := key())}\n")
    assert keys_of("robot") == [theirs]


def test_an_older_key_in_the_users_file_counts_no_more():
    user_file().parent.mkdir()
    user_file().write_text(f"robot {key()}\n")
    remember(Presented("robot", 22, latest := key(), ""))
    assert keys_of("robot") == [latest]


def test_a_file_that_cannot_be_read_is_named():
    user_file().parent.mkdir()
    user_file().write_text("robot\n")
    with pytest.raises(DeploymentError, match="known_hosts cannot be read"):
        keys_of("robot")


@pytest.mark.parametrize(
    ("target", "found"),
    [
        ("robot", ("", "robot", 0)),
        ("me@robot", ("me", "robot", 0)),
        ("me@10.0.0.1:2222", ("me", "10.0.0.1", 2222)),
        ("fd00::1", ("", "fd00::1", 0)),
        ("[fd00::1]:2222", ("", "fd00::1", 2222)),
    ],
)
def test_a_host_is_named_as_for_ssh(target: str, found: tuple[str, str, int]):
    host = host_of(target)
    assert (host.user, host.address, host.port) == found


@pytest.mark.parametrize("target", ["", "me@", "-oProxyCommand=x", "a b", "robot:99999", "[fd00::1"])
def test_what_is_no_host_is_refused(target: str):
    with pytest.raises(DeploymentError, match="is not a host"):
        host_of(target)
