"""The code of the templates that was made beforehand; test_golden.py tests that it is that of the templates."""

from __future__ import annotations

import json
from importlib.metadata import version

from jinja2.bccache import Bucket

from robocomp_py.codegen.compiled import FILE, Compiled
from robocomp_py.codegen.generate import environment

TEXT = FILE.read_text(encoding="utf-8")


def test_code_is_for_one_text_and_one_version_of_jinja2() -> None:
    [checksum, *_] = json.loads(TEXT)["code"]
    assert _found(TEXT, checksum)
    assert not _found(TEXT, checksum[::-1])
    assert not _found(TEXT.replace(version("jinja2"), "1.0"), checksum)


def _found(text: str, checksum: str) -> bool:
    bucket = Bucket(environment(), "some.j2", checksum)
    Compiled(text).load_bytecode(bucket)
    return bucket.code is not None


def test_templates_do_the_same_without_it() -> None:
    values = {"name": "Arm", "lower": "arm", "version": "1"}
    texts = [
        each.get_template("starter.cdsl.j2").render(values)
        for each in (environment(), environment().overlay(bytecode_cache=None, cache_size=0))
    ]
    assert texts[0] == texts[1] != ""
