"""Lets a virtual environment import the Ice of the system's Python, and nothing else of that.

    python tests/interop/ice/expose.py .venv

Debian's `python3-zeroc-ice` installs for `/usr/bin/python3`; PyPI's `zeroc-ice` is a source package on Linux, which
takes a C++ compiler and some minutes. An environment made with `--system-site-packages` would see everything else that
the system's Python has, too. So its site-packages gets links to Ice's own packages, which a second run renews. One that
has an Ice of its own is left as it is.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SYSTEM = Path("/usr/bin/python3")
ICE = ("Ice", "IceBox", "IceGrid", "IceMX", "IcePatch2", "IceStorm", "Glacier2", "IcePy.*.so", "*_ice.py")

OF_THE_SYSTEM = "import IcePy, os, sys; print(os.path.dirname(IcePy.__file__)); print(*sys.version_info[:2])"
OF_THE_ENVIRONMENT = "import sys, sysconfig; print(sysconfig.get_path('purelib')); print(*sys.version_info[:2])"


def main(arguments: list[str]) -> str | None:
    """What is wrong, or None."""
    if len(arguments) != 1:
        return "usage: expose.py VIRTUAL_ENVIRONMENT"
    environment = Path(arguments[0]).absolute()
    if not (environment / "pyvenv.cfg").is_file():
        return f"{environment} is not a virtual environment; make one: python3 -m venv {environment}"
    mine = ask(environment / "bin" / "python", OF_THE_ENVIRONMENT)
    if mine is None:
        return f"{environment}/bin/python does not run; make the environment again"
    site, version = Path(mine[0]), mine[1]
    if any(not each.is_symlink() for each in site.glob("IcePy.*.so")):
        return None
    theirs = ask(SYSTEM, OF_THE_SYSTEM)
    if theirs is None:
        return f"{SYSTEM} has no Ice; install it: apt-get install python3-zeroc-ice"
    packages, built_for = Path(theirs[0]), theirs[1]
    if built_for != version:
        return (
            f"the system's Ice is built for Python {built_for.replace(' ', '.')}, and {environment} has "
            f"{version.replace(' ', '.')}; make the environment with {SYSTEM}, or `pip install zeroc-ice` into it"
        )
    for package in (each for pattern in ICE for each in packages.glob(pattern)):
        place = site / package.name
        place.unlink(missing_ok=True)
        place.symlink_to(package)
    return None


def ask(python: Path, program: str) -> list[str] | None:
    """The lines that a program prints, or None if it fails."""
    # neither PYTHON… variables nor the folder we are in count
    answer = subprocess.run([python, "-E", "-s", "-c", program], capture_output=True, text=True, timeout=60, cwd="/")
    return answer.stdout.splitlines() if answer.returncode == 0 else None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
