"""Runs the story of a rescue to its end, and shows what carried messages.

python components/demo.py                        about a minute
python components/demo.py --fast                 the same story in about ten seconds
python components/demo.py --view                 watch it in the browser
python components/demo.py --flat                 in the small world that needs no MuJoCo
python components/demo.py --middleware zeromq    generated for ZeroMQ only

Where MuJoCo (`pip install 'robocomp-py[sim]'`) and OpenGL are installed, the robot is
in a simulated scene (arena.ddsl), and elsewhere in a house seen from above
(rescue.ddsl). Its code is the same.

The demo generates and runs the components in a copy of the folder, so the checkout does
not change. At the end, the SHA-256 of the files that users write shows that another
middleware has changed none of them. The demo also draws the story.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import webbrowser
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from robocomp_py.cli import rcdeploy, rcgen
from robocomp_py.contract.middleware import AUTO, carrier
from robocomp_py.deploy.auto import usable
from robocomp_py.deploy.plan import Plan
from robocomp_py.deploy.planner import make_plan
from robocomp_py.deploy.routes import stays_inside, unfit, unshared
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.runtime.tally import FOLDER

HERE = Path(__file__).resolve().parent
NETWORK = "rescue.ddsl"
SCENE = "arena.ddsl"
FAST = (
    "*.component.period=0.02",
    "world.component.period=0.01",
    "world.params.capacity=10",
    "world.params.battery=31",
    "rescue.params.enough=40",
)
"""Five times faster. On a busy machine the mission may wait while the robot drives on
for seconds. So the battery lasts, and is low before the robot meets the victim."""
FAST_SCENE = ("--clock", "arena", "--speed", "5")
"""Five times faster. In lock-step, a busy machine only makes the story slower."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit code of rcdeploy: 0 if the victim was found."""
    options = _parser().parse_args(arguments)
    middleware = options.middleware or AUTO
    carried = carrier(middleware, AUTO)
    lacking = "it was not asked for" if options.flat else lacks_for_a_scene()
    name, simulator = (NETWORK, "world") if lacking else (SCENE, "arena")
    wrong = unfit(carried) or (
        unshared(carried, simulator) if stays_inside(carried) else None
    )
    if wrong:  # check before generating anything
        print(f"demo.py: --middleware: {wrong}", file=sys.stderr)
        return 2
    if options.view and not lacking and not importlib.util.find_spec("viser"):
        lacking = "pip install 'robocomp-py[viewer]'"
    if options.view and lacking:
        print(f"demo.py: --view: a 3-D scene is not there: {lacking}", file=sys.stderr)
        return 2
    if lacking and not options.flat:
        print(f"The robot is in a house seen from above. For a 3-D scene: {lacking}.")
    before = written_by_users(HERE)
    with tempfile.TemporaryDirectory(prefix="robocomp-demo-") as folder:
        copy, tally = Path(folder, "components"), Path(folder, "tally")
        shutil.copytree(HERE, copy, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        tally.mkdir()
        code = rcgen.main([str(copy / name), "--middleware", middleware])
        if code:
            return code
        plan = make_plan(copy / name, Workspace(), usable=usable)
        assert plan, "the network is right, as tests show"
        picture = options.picture or Path("rescue.svg" if lacking else "rescue.gif")
        with shown(name) if options.view else contextlib.nullcontext():
            code = _run(copy / name, tally, picture.resolve(), options.fast)
        print(
            "\nWhat carried each link, and how many messages, as components counted:\n"
        )
        print("\n".join(carried_lines(plan, tally)))
        print(f"\n{proof(before, written_by_users(copy), middleware)}")
        same = before == written_by_users(copy)
    if code == 0:
        print(f"The story is drawn in {picture.resolve()}: open it in a browser.")
    return code or int(not same)


def lacks_for_a_scene() -> str:
    """What has to be installed to simulate a scene with cameras; "" if nothing."""
    if not importlib.util.find_spec("mujoco"):
        return "pip install 'robocomp-py[sim]'"
    from robocomp_py.sim.unsafe import has_egl, has_osmesa

    return "" if has_egl() or has_osmesa() else "install the package libegl1"


@contextlib.contextmanager
def shown(network: str) -> Iterator[None]:
    """Show a network in the browser from when it runs, until the end of the block."""
    over = threading.Event()
    thread = threading.Thread(target=_show, args=(network, over), name="viewer")
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _show(network: str, over: threading.Event) -> None:
    """Try to view a network until it runs, and end the viewer when all is over."""
    view = ["-m", "robocomp_py.cli.rc", "sim", "view", Path(network).stem]
    while not over.wait(0.5):
        with subprocess.Popen(
            [sys.executable, *view],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # it does not run yet
            text=True,
        ) as viewer:
            assert viewer.stdout
            url = viewer.stdout.readline().strip()
            if url:
                print(f"The scene is shown at {url}", flush=True)
                webbrowser.open(url)
                over.wait()
            viewer.terminate()


def _run(network: Path, tally: Path, picture: Path, fast: bool) -> int:
    given = ["--until", "rescue"]
    if network.name == SCENE:
        given += ["--set", f"arena.params.film={picture}", *(FAST_SCENE * fast)]
    else:
        given += ["--set", f"world.params.picture={picture}"]
        given += [word for each in FAST * fast for word in ("--set", each)]
    os.environ[FOLDER] = str(tally)
    try:
        return rcdeploy.main([str(network), *given])
    finally:
        del os.environ[FOLDER]


_NOT_COPIED = ("__pycache__", ".*", "*.svg", "*.gif")


def written_by_users(folder: Path) -> dict[str, str]:
    """The SHA-256 of each file that is not generated, by path."""
    files = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {
        str(path): hashlib.sha256((folder / path).read_bytes()).hexdigest()
        for path in sorted(files)
        if "generic" not in path.parts
        and not any(
            Path(part).match(each) for part in path.parts for each in _NOT_COPIED
        )
    }


def proof(before: dict[str, str], after: dict[str, str], middleware: str) -> str:
    """A sentence that says whether the files of users have changed."""
    names = before.keys() | after.keys()
    changed = sorted(name for name in names if before.get(name) != after.get(name))
    if changed:
        return f"These files of users have changed: {', '.join(changed)}"
    whole = hashlib.sha256(json.dumps(before, sort_keys=True).encode()).hexdigest()
    return (
        f"The {len(before)} files that users write are the same before and after, "
        f"generated for {middleware}.\nSHA-256 of them all: {whole}"
    )


def carried_lines(plan: Plan, tally: Path) -> Iterator[str]:
    """A line for each link: both ends, the middleware and the number of messages."""
    counted: Counter[tuple[str, str, str]] = Counter()
    for file in sorted(tally.glob("*.json")):
        for row in json.loads(file.read_text(encoding="utf-8")):
            link = row["instance"], row["port"], row["middleware"]
            counted[link] += row["messages"]
    rows = [("component", "uses", "of", "over", "messages")]
    for (client, port, middleware), number in counted.items():
        ways = [way for way in plan.ways if (way.client, way.port) == (client, port)]
        providers = ", ".join(dict.fromkeys(way.provider for way in ways))
        rows.append((client, port, providers, middleware, str(number)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for *texts, messages in rows:
        cells = [f"{text:<{width}}" for text, width in zip(texts, widths, strict=False)]
        yield "  ".join((*cells, f"{messages:>{widths[-1]}}"))


def _parser() -> argparse.ArgumentParser:
    summary, _, examples = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(
        description=summary,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--middleware", help="what carries the messages")
    parser.add_argument("--view", action="store_true", help="show it in the browser")
    parser.add_argument("--fast", action="store_true", help="in ten seconds or so")
    parser.add_argument(
        "--flat", action="store_true", help="in a house seen from above"
    )
    parser.add_argument(
        "--picture",
        type=Path,
        help="file to draw the story in (default: rescue.gif, or rescue.svg if flat)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
