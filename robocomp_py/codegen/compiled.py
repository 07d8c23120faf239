"""The templates as Python code, made beforehand: jinja2 needs five times as long to write it as Python to compile it.

`make golden` writes the file, for one version of jinja2. The code of a template is used only if its text is the same.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

from jinja2 import BytecodeCache, Environment
from jinja2.bccache import Bucket

FILE = Path(__file__).parent / "compiled.json"


class Compiled(BytecodeCache):
    """Gives jinja2 the code that `text` holds; see `text_of`."""

    def __init__(self, text: str) -> None:
        kept = json.loads(text)
        is_fitting = kept.get("jinja2") == version("jinja2")
        self._code: dict[str, list[str]] = kept["code"] if is_fitting else {}

    def load_bytecode(self, bucket: Bucket) -> None:
        if bucket.checksum in self._code:
            bucket.code = compile("\n".join(self._code[bucket.checksum]), f"template {bucket.key}", "exec")

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Do nothing: what is not in the file is made anew in each process."""


def text_of(environment: Environment) -> str:
    """The text of the file, with the code of all templates."""
    assert environment.loader is not None
    code = {}
    for name in environment.list_templates(filter_func=lambda name: name.endswith(".j2")):
        source, filename, _ = environment.loader.get_source(environment, name)
        checksum = Compiled("{}").get_source_checksum(source)
        code[checksum] = environment.compile(source, name, filename, raw=True).split("\n")
    return json.dumps({"jinja2": version("jinja2"), "code": code}, indent=0) + "\n"
