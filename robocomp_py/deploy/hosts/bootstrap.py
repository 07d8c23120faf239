"""Runs on a host before anything of ours is there: sent as an argument to its Python, so it imports nothing of ours and
keeps to what old versions understand, to say which one is needed.

It looks what is missing, takes the bundle if it is not there, unpacks it into a folder of its name, removes old ones,
and becomes the agent. Tells in lines of JSON on standard output.
"""

import sys

if __name__ == "__main__":
    sys.path[:] = [each for each in sys.path if each]  # nothing is imported from the folder that we happen to be in

import json
import os

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, NoReturn

KEPT = 3
"""Bundles that are kept besides those in use, so that changing between networks sends each only once."""


def tell(**what: object) -> None:
    os.write(1, (json.dumps(what) + "\n").encode())


def refuse(why: str) -> "NoReturn":
    tell(tell="refused", why=why)
    raise SystemExit(1)


def exactly(size: int) -> bytes:
    """Exactly `size` octets of standard input."""
    parts = []
    while size:
        part = os.read(0, min(size, 1 << 16))
        if not part:
            raise SystemExit(1)  # the controller has gone
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def line() -> bytes:
    text = b""
    while not text.endswith(b"\n"):
        text += exactly(1)
    return text


def missing(needs: "dict[str, str]") -> "list[str]":
    from importlib.util import find_spec

    return [needs[module] for module in sorted(needs) if find_spec(module) is None]


def own(folder: str) -> None:
    """Make the folder private: its content is executed, and it contains keys."""
    os.makedirs(folder, 0o700, exist_ok=True)
    if os.path.islink(folder):
        refuse(f"{folder} is a symbolic link; remove it, or name a folder of your own: workdir")
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)  # what is checked is what is changed
    try:
        if os.fstat(opened).st_uid != os.getuid():
            refuse(f"{folder} belongs to another user; name a folder of your own: workdir")
        os.fchmod(opened, 0o700)
    finally:
        os.close(opened)


def receive(folder: str, name: str) -> None:
    """Unpack what is sent into the folder, which then exists completely or not at all."""
    import hashlib
    import io
    import shutil
    import tarfile
    import zlib

    size = json.loads(line())["size"]
    inflate, archive = zlib.decompressobj(31), io.BytesIO()
    while size:
        part = exactly(min(size, 1 << 16))
        size -= len(part)
        archive.write(inflate.decompress(part))
    archive.write(inflate.flush())
    if hashlib.sha256(archive.getbuffer()).hexdigest() != name:
        refuse("the bundle arrived damaged")
    draft = f"{folder}.{os.getpid()}.draft"
    os.mkdir(draft, 0o700)
    try:
        archive.seek(0)
        with tarfile.open(fileobj=archive) as members:
            for member in members:
                if member.name.startswith("/") or ".." in member.name.split("/") or not member.isreg():
                    refuse(f"the bundle has an entry that it must not have: {member.name!r}")
                path = os.path.join(draft, member.name)
                os.makedirs(os.path.dirname(path), 0o700, exist_ok=True)
                with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, member.mode & 0o700), "wb") as file:
                    content = members.extractfile(member)
                    assert content, "it is a file"
                    shutil.copyfileobj(content, file)
        if not os.path.isdir(folder):
            os.rename(draft, folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def hold(path: str, how: int) -> int:
    """The descriptor of a locked file; -1 if another process has locked it."""
    import fcntl

    held = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
    try:
        fcntl.flock(held, how)
    except OSError:
        os.close(held)
        return -1
    return held


def remove_old(bundles: str, name: str) -> None:
    """Remove all but the newest bundles and those in use, and what interrupted transfers left."""
    import fcntl
    import shutil

    def age(each: str) -> float:
        try:
            return -os.stat(os.path.join(bundles, each)).st_mtime
        except OSError:
            return 0

    for each in os.listdir(bundles):
        pid = each.split(".")[-2] if each.endswith(".draft") else ""
        if pid.isdigit() and not os.path.exists(f"/proc/{pid}"):
            shutil.rmtree(os.path.join(bundles, each), ignore_errors=True)
    others = [each for each in os.listdir(bundles) if each != name and len(each) == 64]
    for each in sorted(others, key=age)[KEPT:]:
        lock = os.path.join(bundles, each + ".lock")
        held = hold(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if held >= 0:
            shutil.rmtree(os.path.join(bundles, each), ignore_errors=True)
            os.unlink(lock)
            os.close(held)


def main(asked: "dict[str, Any]") -> None:
    if sys.version_info < (3, 11):  # noqa: UP036  # that of another machine
        found = ".".join(map(str, sys.version_info[:2]))
        hint = 'if there is one of another name: python "NAME"; in its `host`'
        refuse(f"Python {found} is too old there, and 3.11 or newer is needed; {hint}")
    import fcntl

    lacking = missing(asked["needs"])
    if lacking:
        packages = " ".join(f"'{each}'" for each in lacking)
        refuse(f"its Python lacks what the components need; there: {sys.executable} -m pip install {packages}")
    home = os.path.expanduser("~")
    workdir = os.path.expanduser(asked["workdir"])
    if workdir and not os.path.isabs(workdir):
        workdir = os.path.join(home, workdir)
    base = os.path.join(workdir or home, ".robocomp")
    bundles, name = os.path.join(base, "bundles"), asked["bundle"]
    folder = os.path.join(bundles, name)
    where = workdir or os.path.join(base, "run", asked["network"])
    own(base)
    for each in (where, bundles):
        os.makedirs(each, 0o700, exist_ok=True)
    held = hold(folder + ".lock", fcntl.LOCK_SH)
    there = os.path.isdir(folder)
    tell(tell="boot", there=there, root=folder, python=sys.executable, folder=where)
    if not there:
        receive(folder, name)
    os.utime(folder)
    remove_old(bundles, name)
    os.set_inheritable(held, True)  # as long as the agent lives
    os.chdir(where)
    paths = [folder] + [each for each in os.environ.get("PYTHONPATH", "").split(os.pathsep) if each]
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(paths), PYTHONUNBUFFERED="1")
    module = "robocomp_py.deploy.agent"
    os.execve(sys.executable, [sys.executable, "-P", "-m", module, asked["network"]], environment)


if __name__ == "__main__":
    try:
        main(json.loads(sys.argv[1]))
    except OSError as exc:
        refuse(f"{exc.filename or 'it failed'}: {exc.strerror}")
