"""Files in Python 2 are run as they are."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from robocomp_py.classic.workers.imports import code_of, source_text
from robocomp_py.classic.workers.python2 import NotConverted, _tool, as_python3


def ran(text: str | bytes, tmp_path: Path) -> dict[str, object]:
    file = tmp_path / "their.py"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    names: dict[str, object] = {}
    exec(code_of(file), names)
    return names


@pytest.mark.parametrize(
    "text",
    [
        "try:\n    1 / 0\nexcept ZeroDivisionError, e:\n    print 'never', e\n    found = 3",
        "import Queue\nfound = 3 if 'x' <> 'y' and Queue.Queue else 0\n",
        "if True:\n\tif True:\n        \tfound = 3\n",
        "if True:\r\n\tprint u'no', 3\r\n\tfound = len({}.keys()) + 3\r\n",
    ],
)
def test_what_python_2_took_is_taken(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(text, tmp_path)["found"] == 3


def test_python_3_is_left_as_it_is() -> None:
    text = "print('hello')\nmap(str, [])\n"
    assert as_python3(text, "their.py") == (text, False)


def test_lines_stay_where_they_are(tmp_path: Path) -> None:
    text = 'print "one"\n\nfrom itertools import izip\nimport urllib2\ndef f(x):\n\n\treturn x / 0\n'
    with pytest.raises(ZeroDivisionError) as caught:
        ran(text.replace("import urllib2\n", "\n") + "f(1)\n", tmp_path)
    assert [entry.lineno for entry in caught.traceback[-2:]] == [7, 6]


def test_what_is_neither_says_where() -> None:
    with pytest.raises(NotConverted) as caught:
        as_python3("x = 1\ndef (:\n", "their.py")
    assert caught.value.lineno == 2


def test_a_python_without_the_converter_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("lib2to3", "fissix"):
        monkeypatch.setitem(sys.modules, f"{package}.refactor", None)
    _tool.cache_clear()
    try:
        with pytest.raises(NotConverted) as caught:
            as_python3("print 'without'\n", "their.py")
        assert "install a converter for Python" in caught.value.why
    finally:
        _tool.cache_clear()


@pytest.mark.parametrize(
    "data",
    [
        "# -*- coding: utf-8 -*-\nname = 'ñ'\n".encode(),
        b"# -*- coding: latin-1 -*-\nname = '\xf1'\n",
        b"name = '\xf1'\n",
        "\ufeffname = 'ñ'\n".encode(),
        b"# coding: nonsense\nname = '\xf1'\n",
    ],
)
def test_texts_are_read_by_the_encoding_they_declare_or_were_written_in(data: bytes, tmp_path: Path) -> None:
    assert "ñ" in source_text(data)
    assert ran(data, tmp_path)["name"] == "ñ"
