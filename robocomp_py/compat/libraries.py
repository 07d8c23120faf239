"""What to do about a library that a component imports and that is not there."""

from __future__ import annotations

from pathlib import Path

from ..runtime.trace import frames_in

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
}
"""Where a library is installed by another name than it is imported."""

_OF_PYTHON = {"tkinter": "python3-tk", "_tkinter": "python3-tk"}
"""What Debian splits off Python's own library."""

_OF_ROBOCOMP = ("librobocomp_", "pydsr", "agmlib", "AGMModule", "parseAGGL", "innermodel", "ConfigLoader")


def advice(exc: ModuleNotFoundError, folder: Path) -> str:
    """Which file lacks what, and how to come by it."""
    name = exc.name or str(exc)
    head = name.partition(".")[0]
    frames = frames_in(folder, exc)
    where = f"{frames[-1][0].f_code.co_filename}:{frames[-1][1]}" if frames else str(folder)
    if head in ("src", "generated"):
        return f"{where}: imports `{name}`, which is not there in {folder}"
    if head.startswith(_OF_ROBOCOMP):
        return f"{where}: imports `{name}`, a library of RoboComp's own, which has to be installed from there"
    if head.startswith("RoboComp"):
        return (
            f"{where}: imports `{name}`, which no .idsl that its .cdsl imports defines; import it there, and run rcgen"
        )
    absent = f"{where}: imports `{name}`, which is not installed here; try:"
    if head in _OF_PYTHON:
        return f"{absent} apt-get install {_OF_PYTHON[head]}"
    return f"{absent} pip install {_PACKAGES.get(head, head)}"
