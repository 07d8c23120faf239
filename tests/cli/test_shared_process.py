"""Several components in one process, as people run and deploy them."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen

from .programs import running

ASKER = """
import "../../hello/Hello.idsl";
Component %s { Communications { requires Hello; }; language python; period 20 ms; };
"""
ASKING = """
    def initialize(self) -> None:
        SEEN.append(self.log.name)
        self.log.info("seen: %s", ", ".join(SEEN))

    def finish(self) -> None:
        self.log.info("asked: %s", self.hello_proxy.greet("Ada"))
"""
STUCK = """
    def compute(self) -> None:
        self.log.debug("not so important")
        self.log.info("stuck")
        while True:
            pass
"""
FAILING = """
    def compute(self) -> None:
        raise ZeroDivisionError("divided")
"""
BRIEF = """
    def compute(self) -> None:
        self.stop()
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A server, and several that use it, in folders of the same name."""
    root = tmp_path_factory.mktemp("shared")
    assert rcgen(["--new", "Hello", "-o", str(root / "hello")]) == 0
    for kind, code in {"asking": ASKING, "stuck": STUCK, "failing": FAILING, "brief": BRIEF}.items():
        model = root / kind / "hello" / "hello.cdsl"
        model.parent.mkdir(parents=True)
        model.write_text(ASKER % kind)
        assert rcgen([str(model)]) == 0
        worker = model.parent / "specificworker.py"
        text, begin = worker.read_text(), worker.read_text().index("    def compute")
        hooks = text if code == ASKING else text[:begin]
        worker.write_text(hooks.replace("\nclass ", "\nSEEN: list[str] = []\n\n\nclass ", 1) + code)
    return root


def test_each_has_its_own_options_and_variables_and_they_end_backwards(folder: Path) -> None:
    asking = folder / "asking" / "hello"
    with running(
        *("rc", "run", folder / "hello", "--set", "greeting=Hi", "+", asking, "--name", "left"),
        *("+", asking, "--name", "right", "--after", "left", "--set", "component.log=error"),
    ) as program:
        program.wait_for("hello INFO: ready", "left INFO: seen: left", "left INFO: ready")
        program.send_signal(signal.SIGTERM)
    assert program.returncode == 128 + signal.SIGTERM
    said = [line[len("12:34:56 ") :] for line in program.lines if re.search("ready|seen:|asked:", line)]
    assert sorted(said) == [
        "hello INFO: ready",
        "left INFO: asked: Hi, Ada!",
        "left INFO: ready",
        "left INFO: seen: left",
    ]


def test_a_component_that_fails_ends_the_process_and_the_others_finish(folder: Path) -> None:
    with running(
        *("rc", "run", folder / "hello", "+", folder / "asking" / "hello", "--name", "left"),
        *("+", folder / "failing" / "hello", "--name", "failing", "--after", "left"),
    ) as program:
        pass
    assert program.returncode == 1
    text = "\n".join(program.lines)
    assert "failing ERROR: SpecificWorker.compute raised ZeroDivisionError" in text
    assert "left INFO: asked: Hello, Ada!" in text


def test_a_stuck_one_is_named_and_the_second_interrupt_ends_all(folder: Path) -> None:
    with running(
        *("rc", "run", folder / "hello", "+", folder / "stuck" / "hello", "--name", "lazy"),
        *("--set", "component.log=debug"),
    ) as program:
        program.wait_for("lazy INFO: stuck", "lazy DEBUG: not so important")
        program.send_signal(signal.SIGINT)
        program.wait_for("lazy was asked to stop 2 s ago, but is still busy with SpecificWorker.compute; press")
        program.send_signal(signal.SIGINT)
    assert program.returncode == 130


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["+"], 2, "give it the folder of a component behind each `+`"),
        (["+", "hello"], 1, "two components of the process are named `hello`; give each its own --name"),
        (
            ["+", "hello", "--name", "b", "--after", "helo"],
            1,
            "b: --after: unknown instance `helo`; did you mean `hello`?",
        ),
        (["--after", "b", "+", "hello", "--name", "b", "--after", "hello"], 1, "b: --after: `b` waits for itself"),
        (["+", "hello", "--name", "b", "--print-config"], 2, "--print-config is for one component, without a `+`"),
        (
            ["--set", "greting=1", "+", "hello", "--name", "b", "--set", "x=1"],
            1,
            "did you mean `greeting`?\nb: --set x=1",
        ),
        (["+", "asking"], 1, "asking is not a generated component"),
        (["--after", "b"], 2, "no option --after; see: rc run hello --help"),
    ],
)
def test_components_that_cannot_share_a_process_are_reported_before_the_start(
    folder: Path,
    arguments: list[str],
    code: int,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert exit_code(["run", "hello", *arguments]) == code
    said = capsys.readouterr()
    assert message in said.err
    assert said.out == ""


def exit_code(arguments: list[str]) -> object:
    try:
        return rc(arguments)
    except SystemExit as exc:  # from argparse
        return exc.code


def network(folder: Path, body: str) -> Path:
    path = folder / "net.ddsl"
    imports = "".join(f'import "{each}/hello.cdsl"; ' for each in ("hello", "asking/hello", "brief/hello"))
    path.write_text(f"{imports}\nDeployment net\n{{\n{body}\n}};\n")
    return path


INSIDE = """
    middleware inproc;
    Component hello { process body; };
    Component asking { process body; dependences hello; };
    Component brief { process body; dependences asking; };
"""


def test_a_network_can_be_one_process_with_messages_inside_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = ("--record-logs", "json", "--log-dir", tmp_path)
    with running("rcdeploy", network(folder, INSIDE), "--until", "brief", *kept) as deployer:
        pass
    text = "\n".join(deployer.lines)
    assert deployer.returncode == 0, text
    assert "rcdeploy │ all 3 components of net are ready" in text
    assert "rcdeploy │ stopping: brief has ended" in text
    assert "body │ asking: asked: Hello, Ada!" in text
    assert rcdeploy(["logs", "net", "--json", "--level", "info", "--grep", "^asked"]) == 0
    [record] = map(json.loads, capsys.readouterr().out.splitlines())
    assert [record[key] for key in ("name", "instance", "level", "text")] == [
        *("body", "asking", "info", "asked: Hello, Ada!")
    ]
    assert record["file"].endswith("asking/hello/specificworker.py")


def test_a_killed_process_is_reported_once_with_all_that_were_in_it(folder: Path) -> None:
    path = network(folder, INSIDE.replace("Component brief { process body; dependences asking; };", ""))
    with running("rcdeploy", path) as deployer:
        deployer.wait_for("both components of net are ready")
        children = Path(f"/proc/{deployer.pid}/task/{deployer.pid}/children").read_text().split()
        [pid] = [int(pid) for pid in children if b"--name\0asking" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        os.kill(pid, signal.SIGKILL)
    text = "\n".join(deployer.lines)
    assert deployer.returncode == 1
    assert text.count("rcdeploy │ body (hello, asking) was ended by signal 9") == 1
    assert text.count("was ended by") == 1


def test_a_plan_shows_which_instances_share_a_process(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = network(
        folder, "Component hello { process body; }; Component asking { process body; }; Component brief { };"
    )
    assert rcdeploy(["plan", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    [head] = [line for line in lines if "process" in line.split()]
    at = head.index("process")
    assert [(line.split()[1], line[at : at + 7].strip()) for line in lines if line[:1].isdigit()] == [
        ("hello", "body"),
        ("asking", "body"),
        ("brief", ""),
    ]
