"""What to do about a library that a component imports and that is not there."""

from __future__ import annotations

import traceback
from pathlib import Path

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
    "pyrealsense2": "pyrealsense2",
    "gi": "PyGObject",
    "Phidget22": "Phidget22",
    "speech_recognition": "SpeechRecognition",
    "google": "google-cloud",
    "vlc": "python-vlc",
    "dbus": "dbus-python",
    "apriltag": "apriltag",
    "bs4": "beautifulsoup4",
    "passlib": "passlib",
    "zmq": "pyzmq",
}
"""Where a library is installed by another name than it is imported."""

_OF_ROBOCOMP = ("librobocomp_", "pydsr", "agmlib", "AGMModule", "parseAGGL", "innermodel", "ConfigLoader")


def advice(exc: ModuleNotFoundError, folder: Path) -> str:
    """Which file lacks what, and how to come by it."""
    name = exc.name or str(exc)
    head = name.partition(".")[0]
    frames = [each for each in traceback.extract_tb(exc.__traceback__) if Path(each.filename).is_relative_to(folder)]
    where = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else str(folder)
    if head in ("src", "generated"):
        return f"{where}: imports `{name}`, which is not there in {folder}"
    if head.startswith(_OF_ROBOCOMP):
        return f"{where}: imports `{name}`, a library of RoboComp's own, which has to be installed from there"
    if head.startswith("RoboComp"):
        return (
            f"{where}: imports `{name}`, which no .idsl that its .cdsl imports defines; import it there, and run rcgen"
        )
    return f"{where}: imports `{name}`, which is not installed here; try: pip install {_PACKAGES.get(head, head)}"
