"""A plug-in is light until it has something to do: it is asked about each folder and file that is not ours."""

from __future__ import annotations

from ..test_layers import BUILD, MIDDLEWARES, left_layers

EXISTING = "robocomp_py.classic.workers.existing"
FORBIDDEN = {
    "robocomp_py.classic.configuration": BUILD | MIDDLEWARES | {"Ice", "msgpack", EXISTING},
    "robocomp_py.classic.workers": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.runtime", EXISTING},
    "robocomp_py.classic.workers.qt": BUILD
    | MIDDLEWARES
    | {"PySide6", "robocomp_py.runtime.run", "robocomp_py.classic.workers.qt.real"},
    EXISTING: BUILD | MIDDLEWARES | {"PySide6", "Ice", "msgpack", "lib2to3"},
    "robocomp_py.classic.workers.python2": BUILD | MIDDLEWARES | {"numpy", "robocomp_py.runtime", "lib2to3"},
}


def test_imports_stay_within_their_layer() -> None:
    assert left_layers(FORBIDDEN) == {}
