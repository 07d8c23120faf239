"""Nothing that comes from a wire or a file is ever run: no pickle, no eval, no shell. The rules, and that they bite."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.contract.types import INT32, STRING, Enumeration, Field, Sequence, Struct
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import Codec
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.messagepack import MessagePack

from .codegen.generated import copied

ROOT = Path(__file__).parents[1]

MODULES = frozenset({
    "pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "jsonpickle", "marshal", "shelve",
    "multiprocessing", "code", "codeop",
})  # fmt: skip
"""What makes objects or code of bytes, or is made upon it."""

FUNCTIONS = frozenset({"eval", "exec", "compile", "__import__"})

METHODS = {
    "os": frozenset({"system", "popen"}),
    "subprocess": frozenset({"getoutput", "getstatusoutput"}),
    "asyncio": frozenset({"create_subprocess_shell"}),
    "yaml": frozenset({"load", "load_all", "unsafe_load", "unsafe_load_all", "full_load", "full_load_all"}),
    "builtins": FUNCTIONS,
    "types": frozenset({"FunctionType", "CodeType"}),
}
"""By module."""

ANYWHERE = frozenset(
    ["recv_pyobj", "send_pyobj", "recv_serialized", "send_serialized", "read_pickle", "to_pickle", "subprocess_shell"]
)
"""Of whatever object."""

KEYWORDS = {"shell", "allow_pickle"}
"""Which may not be true."""

ALLOWED = {
    "robocomp_py/wire/program.py": {"exec": 1, "compile": 1},  # codecs, from texts without any foreign word
    "robocomp_py/codegen/compiled.py": {"compile": 1},  # templates of this package, as jinja2 wrote them in Python
    # files of a component in the folder that is run, as an import statement of theirs finds them
    "robocomp_py/cli/common.py": {"exec": 1},  # of nothing
    "robocomp_py/classic/workers/imports.py": {"exec": 1, "compile": 1, "__import__": 1},
    "robocomp_py/classic/workers/qt/core.py": {"exec": 1},  # a method of Qt's, by its two names
    "robocomp_py/testing/parts.py": {"multiprocessing": 1},  # victims of tests, which they start themselves
    "robocomp_py/testing/actors.py": {"multiprocessing": 1},
    "benchmarks/pair.py": {"multiprocessing": 2},  # the two ends of a measurement, likewise
    "benchmarks/scale/crowd.py": {"multiprocessing": 2},
}


WORDS = re.compile(rf"\b({'|'.join(MODULES | FUNCTIONS | ANYWHERE | KEYWORDS | set().union(*METHODS.values()))})\b")


def found(source: str) -> Iterator[str]:
    """What a module does that it must not do."""
    if not WORDS.search(source):
        return  # most are without, and parsing takes a while
    nodes = list(ast.walk(ast.parse(source)))
    aliases = {
        alias.asname: alias.name
        for node in nodes
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.asname
    }
    for node in nodes:
        match node:
            case ast.Import(names=names):
                yield from (top for each in names if (top := each.name.partition(".")[0]) in MODULES)
            case ast.ImportFrom(module=module, names=names, level=0):
                top = (module or "").partition(".")[0]
                if top in MODULES:
                    yield top
                yield from (f"{top}.{each.name}" for each in names if each.name in METHODS.get(top, ()))
                yield from (each.name for each in names if each.name in MODULES)
            case ast.Name(id=name) if name in FUNCTIONS and isinstance(node.ctx, ast.Load):
                yield name  # also where it is only passed on
            case ast.Attribute(value=ast.Name(id=owner), attr=name) if name in METHODS.get(
                aliases.get(owner, owner), ()
            ):
                yield f"{aliases.get(owner, owner)}.{name}"
            case ast.Attribute(attr=name) if name in ANYWHERE:
                yield name
            case ast.keyword(arg=name, value=value) if name in KEYWORDS:
                if not (isinstance(value, ast.Constant) and value.value is False):
                    yield f"{name}={ast.unparse(value)}"
            case ast.Call(func=ast.Attribute(attr="import_module"), args=[ast.Constant(value=str(module)), *_]):
                if module.partition(".")[0] in MODULES:
                    yield module


def modules() -> list[Path]:
    folders = ("robocomp_py", "components", "examples", "benchmarks")
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def test_no_module_of_ours_runs_what_it_is_sent() -> None:
    read = modules()
    assert len(read) > 300
    for path in read:
        name = str(path.relative_to(ROOT))
        there = {what: len(list(group)) for what, group in itertools.groupby(sorted(found(path.read_text())))}
        assert there == ALLOWED.get(name, {}), name


def test_no_generated_module_runs_what_it_is_sent(tmp_path: Path) -> None:
    for name, middleware in (("everything", "zeromq"), ("patrol", "dds")):
        assert rcgen([str(copied(name, tmp_path / name)), "--middleware", middleware]) == 0
    generated = list(tmp_path.rglob("*.py"))
    assert len(generated) > 5
    assert {str(path): list(found(path.read_text())) for path in generated} == {str(path): [] for path in generated}


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("import pickle", "pickle"),
        ("import pickle as p", "pickle"),
        ("from pickle import loads", "pickle"),
        ("import marshal, os", "marshal"),
        ("def f():\n    import shelve", "shelve"),
        ("from multiprocessing.connection import Client", "multiprocessing"),
        ("import importlib\nimportlib.import_module('pickle')", "pickle"),
        ("eval(text)", "eval"),
        ("exec(text)", "exec"),
        ("run = eval", "eval"),
        ("list(map(eval, texts))", "eval"),
        ("__import__(name)", "__import__"),
        ("import builtins\nbuiltins.eval(text)", "builtins.eval"),
        ("import os\nos.system(line)", "os.system"),
        ("import os as o\no.system(line)", "os.system"),
        ("from os import popen", "os.popen"),
        ("import subprocess\nsubprocess.run(line, shell=True)", "shell=True"),
        ("import subprocess\nsubprocess.run(line, shell=quick)", "shell=quick"),
        ("import asyncio\nasyncio.create_subprocess_shell(line)", "asyncio.create_subprocess_shell"),
        ("import yaml\nyaml.load(text)", "yaml.load"),
        ("from yaml import load", "yaml.load"),
        ("socket.recv_pyobj()", "recv_pyobj"),
        ("frames = self._socket.recv_pyobj", "recv_pyobj"),
        ("import numpy as np\nnp.load(file, allow_pickle=True)", "allow_pickle=True"),
    ],
)
def test_what_is_planted_is_found(source: str, told: str) -> None:
    assert list(found(source)) == [told]


@pytest.mark.parametrize(
    "source",
    [
        "import re\nre.compile(text)",
        "program.compile('encode')",
        "import yaml\nyaml.safe_load(text)",
        "import subprocess\nsubprocess.run(words, shell=False)",
        "import numpy as np\nnp.load(file, allow_pickle=False)",
        "worker.evaluate(x)",
        "# eval(x)",
        "'exec(x)'",
    ],
)
def test_what_is_harmless_is_not(source: str) -> None:
    assert list(found(source)) == []


class Ran(Exception):
    """Somebody's data was run."""


@pytest.mark.parametrize("codec", [MessagePack(), Cdr(), Ice()])
def test_codecs_compile_no_word_of_a_contract_or_a_value(codec: Codec) -> None:
    """Names of types and fields are in no text that is compiled, whatever they are."""
    evil = "x'\"\n    raise SystemExit('run')\n    #"
    inner = Struct(f"M::{evil}", (Field(evil, STRING), Field("é" + evil, Sequence(INT32))))
    color = Enumeration(f"M::Color{evil}", ((f"RED{evil}", 0), ("BLUE", 7)))
    outer = Struct(f"M::Outer{evil}", (Field(f"a{evil}", inner), Field(f"b{evil}", color)))
    encode, decode = codec.encoder(outer), codec.decoder(outer)
    assert decode(encode(((evil, [1, 2, 3]), 7)))[1] == 7
