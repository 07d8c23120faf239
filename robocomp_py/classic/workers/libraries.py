"""What to do about a library that a component imports and that is not there."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from ...runtime.trace import frames_in

_PACKAGES = {
    "cv2": "opencv-python",
    "serial": "pyserial",
    "yaml": "PyYAML",
    "PIL": "Pillow",
    "sklearn": "scikit-learn",
    "skimage": "scikit-image",
    "usb": "pyusb",
    "Xlib": "python-xlib",
    "dateutil": "python-dateutil",
    "gi": "PyGObject",
    "speech_recognition": "SpeechRecognition",
    "vlc": "python-vlc",
    "dbus": "dbus-python",
    "bs4": "beautifulsoup4",
    "zmq": "pyzmq",
    "google.protobuf": "protobuf",
    "Ice": "'robocomp-py[ice]'",
    "IceStorm": "'robocomp-py[ice]'",
    "rtde_control": "ur-rtde",
    "rtde_receive": "ur-rtde",
    "Crypto": "pycryptodome",
    "OpenGL": "PyOpenGL",
}
"""Where a library is installed by another name than it is imported; by its own name, or that of its package."""

_OF_PYTHON_2 = {
    "mutex": "threading.Lock",
    "Queue": "queue",
    "ConfigParser": "configparser",
    "Tkinter": "tkinter",
    "cPickle": "pickle",
    "StringIO": "io",
    "cStringIO": "io",
    "urllib2": "urllib.request",
    "urlparse": "urllib.parse",
    "commands": "subprocess",
    "thread": "threading",
    "sets": "set",
    "HTMLParser": "html.parser",
    "httplib": "http.client",
    "SocketServer": "socketserver",
    "SimpleHTTPServer": "http.server",
    "BaseHTTPServer": "http.server",
    "xmlrpclib": "xmlrpc.client",
    "__builtin__": "builtins",
}
"""Modules of Python 2, and what has taken their place."""

_OF_PYTHON = {"tkinter": "python3-tk", "_tkinter": "python3-tk"}
"""What Debian splits off Python's own library."""

_OF_ROBOCOMP = ("librobocomp_", "pydsr", "agmlib", "AGMModule", "parseAGGL", "innermodel", "ConfigLoader")


def advice(exc: ModuleNotFoundError, folder: Path) -> str:
    """Which file lacks what, and how to come by it."""
    frames = frames_in(folder, exc)
    name = exc.name or str(exc)
    if frames:
        name = _imported(name, Path(frames[-1][0].f_code.co_filename), frames[-1][1])
    head = name.partition(".")[0]
    where = f"{frames[-1][0].f_code.co_filename}:{frames[-1][1]}" if frames else str(folder)
    if head in ("src", "generated"):
        return f"{where}: imports `{name}`, which is not there in {folder}"
    if head.startswith(_OF_ROBOCOMP):
        return f"{where}: imports `{name}`, a library of RoboComp's own, which has to be installed from there"
    if head.startswith("RoboComp"):
        return (
            f"{where}: imports `{name}`, which no .idsl that its .cdsl imports defines; import it there, and run rcgen"
        )
    if head in _OF_PYTHON_2:
        return f"{where}: imports `{name}` of Python 2; in Python 3, use `{_OF_PYTHON_2[head]}`"
    absent = f"{where}: imports `{name}`, which is not installed here; try:"
    if head in _OF_PYTHON:
        return f"{absent} apt-get install {_OF_PYTHON[head]}"
    package = next((_PACKAGES[part] for part in _packages(name) if part in _PACKAGES), head)
    return f"{absent} pip install {package}"


def _imported(missing: str, file: Path, line: int) -> str:
    """What the import at a line of a file asks for below a missing package: Python names only the outermost."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, ValueError, SyntaxError):
        return missing
    for each in ast.walk(tree):
        match each:
            case ast.Import(names=names, lineno=first, end_lineno=last):
                asked = [alias.name for alias in names]
            case ast.ImportFrom(module=str(module), names=names, level=0, lineno=first, end_lineno=last):
                asked = [f"{module}.{alias.name}" for alias in names]
            case _:
                continue
        if first <= line <= (last or first):
            return next((name for name in asked if name.startswith(f"{missing}.")), missing)
    return missing


def _packages(name: str) -> Iterator[str]:
    """A module and the packages that it is in, the innermost first."""
    while name:
        yield name
        name = name.rpartition(".")[0]
