"""Grammars are made once, and kept; nothing depends on whether they are."""

from __future__ import annotations

import json
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from robocomp_py.dsl.parsing import Parser
from robocomp_py.dsl.tables import Tables, read_tables

LANGUAGES = ("idsl", "cdsl", "pdsl", "ddsl", "smdsl")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "robocomp_py" / "grammars"


def plain(tables: Tables) -> str:
    return json.dumps(tables)


@pytest.mark.parametrize("name", LANGUAGES)
def test_what_is_kept_is_what_was_made(name: str, cache: Path) -> None:
    made = read_tables(name)
    [file] = cache.iterdir()
    written = file.stat().st_mtime_ns
    assert plain(read_tables(name)) == plain(made)
    assert file.stat().st_mtime_ns == written


DAMAGE = [b"", b"{}", b"[]", b"null", b'{"key": 1}', b"not JSON", b"\0", b"\xff\xfe"]


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_nobody_of_us_wrote_is_replaced(damage: bytes, cache: Path) -> None:
    read_tables("pdsl")
    [file] = cache.iterdir()
    file.write_bytes(damage)
    made = read_tables("pdsl")
    assert plain(read_tables("pdsl")) == plain(made)
    assert file.read_bytes() != damage


def test_what_was_made_from_something_else_is_made_anew(cache: Path) -> None:
    read_tables("pdsl")
    [file] = cache.iterdir()
    file.write_text(json.dumps({**json.loads(file.read_text()), "key": "of another version", "start": 999}))
    assert read_tables("pdsl").start != 999


def test_what_is_kept_is_for_its_user_alone(cache: Path) -> None:
    read_tables("pdsl")
    for each in (cache.parent, cache, *cache.iterdir()):
        assert stat.S_IMODE(each.stat().st_mode) & 0o077 == 0


def test_of_many_that_keep_a_grammar_at_once_one_does_and_nothing_is_left_beside_it(cache: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        made = list(pool.map(lambda _: plain(read_tables("pdsl")), range(8)))
    assert plain(read_tables("pdsl")) in made
    assert [each.name for each in cache.iterdir()] == ["pdsl.json"]


def test_without_a_place_for_them_grammars_are_made_each_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where a folder should be")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert Parser("smdsl").parse("a { initial_state b; };").data == "start"


def test_nothing_is_written_where_nobody_knows_where_home_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.chdir(tmp_path)
    read_tables("smdsl")
    assert list(tmp_path.iterdir()) == []
