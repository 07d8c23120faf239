"""The files that are expected to be generated. `python -m tests.codegen.golden` rewrites them; review their diff."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import robocomp_py
from robocomp_py.codegen.compiled import FILE, text_of
from robocomp_py.codegen.generate import environment, generate_module
from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Verb
from robocomp_py.dsl.workspace import SHIPPED, Workspace

from .generated import NAMES, artifacts

GOLDEN = Path(__file__).parent / "golden"
PACKAGE = Path(robocomp_py.__file__).parent
OWN = {
    SHIPPED / "CommonBehavior.idsl": PACKAGE / "runtime" / "RoboCompCommonBehavior.py",
    SHIPPED / "Introspection.idsl": PACKAGE / "runtime" / "RoboCompIntrospection.py",
    SHIPPED / "Clock.idsl": PACKAGE / "lockstep" / "RoboCompClock.py",
    PACKAGE / "lockstep" / "Lockstep.idsl": PACKAGE / "lockstep" / "RoboCompLockstep.py",
}
"""The generated files that are part of the run time, by their sources."""

TEXTS = PACKAGE / "runtime" / "introspected.py"


def expected() -> Iterator[tuple[Path, str]]:
    """Every golden file with the text it has to have."""
    for name in NAMES:
        for artifact in artifacts(name):
            yield GOLDEN / name / artifact.path, artifact.text
    for source, path in OWN.items():
        module = Workspace().interfaces(source)
        assert module is not None
        interfaces = [each for each in module.definitions if isinstance(each, Interface)]
        required = () if source.is_relative_to(SHIPPED) else [Port(Verb.REQUIRES, each) for each in interfaces]
        yield path, generate_module(module, required)

    yield TEXTS, _introspected()


def _introspected() -> str:
    """The contracts of `Introspection` that its port announces before its types are imported."""
    module = Workspace().interfaces(SHIPPED / "Introspection.idsl")
    assert module is not None
    interface = next(each for each in module.definitions if isinstance(each, Interface))
    lines = []
    for operation in interface.operations:
        if operation.outputs:
            lines += [f'    "{operation.name}": """\\', f'{operation.text}""",']
    return "\n".join((*_HEAD, *lines, "}", ""))


_HEAD = (
    '"""The contracts of `Introspection`, by operation. Made by `make golden`: edits are lost."""',
    "",
    "TEXTS = {",
)


def main() -> None:
    FILE.write_text(text_of(environment()), encoding="utf-8")
    for name in NAMES:
        shutil.rmtree(GOLDEN / name, ignore_errors=True)
    for path, text in expected():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
