"""A component as a program: options, exit codes, signals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.errors import ComponentError
from robocomp_py.runtime.ending import grace_of
from robocomp_py.runtime.load import load_worker
from robocomp_py.testing.patience import SOON


@pytest.fixture(scope="module")
def hello(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A generated component."""
    folder = tmp_path_factory.mktemp("components") / "hello"
    assert rcgen(["--new", "Hello", "-o", str(folder)]) == 0
    return folder


def test_an_import_without_its_dot_is_told_with_the_remedy(tmp_path: Path) -> None:
    assert rcgen(["--new", "Robot", "-o", str(tmp_path / "robot")]) == 0
    worker = tmp_path / "robot" / "specificworker.py"
    worker.write_text(worker.read_text().replace("from .generic", "from generic"))
    with pytest.raises(
        ComponentError, match=r"write `from \.generic\S* import …`, with a dot: a component is a package"
    ):
        load_worker(tmp_path / "robot", afresh=True)


def run(*command: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, cwd=cwd, timeout=SOON * 6)


@contextmanager
def started(
    *command: str, cwd: Path | None = None, before: list[str] | None = None, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """A process, once it has said that it is ready. What it says until then is put into `before`."""
    process = subprocess.Popen(
        [sys.executable, "-m", *command], cwd=cwd, stderr=subprocess.PIPE, text=True, env=os.environ | environment
    )
    assert process.stderr is not None
    seen: list[str] = [] if before is None else before
    try:
        for line in process.stderr:
            seen.append(line)
            if "ready" in line:
                break
        else:
            raise AssertionError("".join(seen))
        yield process
        process.wait(SOON * 3)
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


FINISH = """
    def finish(self) -> None:
        import os
        self.log.info("finishing")
        while not os.path.exists("go on"):
            os.sched_yield()
        self.log.info("finished")
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_in_finish(hello: Path, tmp_path: Path, number: int, code: int) -> None:
    worker = hello / "specificworker.py"
    before = worker.read_text()
    worker.write_text(before + FINISH)
    try:
        with started("robocomp_py.cli.rc", "run", str(hello), cwd=tmp_path) as process:
            process.send_signal(number)
            assert process.stderr is not None
            assert any("finishing" in line for line in process.stderr)
            process.send_signal(signal.SIGTERM)  # which does not interrupt it
            (tmp_path / "go on").touch()
            assert "finished" in process.stderr.read()
        assert process.returncode == code
    finally:
        worker.write_text(before)


LOSING = """
    def __init__(self) -> None:
        import signal

        class Last:
            def __del__(self) -> None:
                signal.raise_signal(signal.SIGTERM)

        Last()
"""


def test_a_signal_that_is_lost_while_it_is_made_ends_it_all_the_same(hello: Path) -> None:
    worker = hello / "specificworker.py"
    before = worker.read_text()
    worker.write_text(before + LOSING)
    try:
        assert run("robocomp_py.cli.rc", "run", str(hello)).returncode == 143
    finally:
        worker.write_text(before)


def test_a_component_runs_as_a_module(hello: Path) -> None:
    with started("hello", cwd=hello.parent) as process:
        process.send_signal(signal.SIGINT)
    assert process.returncode == 130


def test_readiness_is_reported_to_the_launcher(hello: Path, tmp_path: Path) -> None:
    import socket

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(str(tmp_path / "n"))
        channel.settimeout(3 * SOON)
        with started("robocomp_py.cli.rc", "run", str(hello), NOTIFY_SOCKET=str(tmp_path / "n")) as process:
            assert channel.recv(100).startswith(b"X_ROBOCOMP_CONTRACT=")
            assert channel.recv(100) == b"READY=1"
            process.send_signal(signal.SIGTERM)
            assert channel.recv(100) == b"STOPPING=1"


def test_a_launcher_that_has_gone_does_no_harm(hello: Path, tmp_path: Path) -> None:
    with started("robocomp_py.cli.rc", "run", str(hello), NOTIFY_SOCKET=str(tmp_path / "gone")) as process:
        process.send_signal(signal.SIGTERM)
    assert process.returncode == 143


def test_a_wrong_configuration_is_said_and_nothing_is_opened(hello: Path, tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-m", "robocomp_py.cli.rc", "run", str(hello), "--set", "params.greetin=3"],
        capture_output=True,
        text=True,
        env=os.environ | {"ROBOCOMP_RUNTIME_DIR": str(tmp_path / "never")},
    )
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == "--set params.greetin=3: unknown parameter `greetin`; did you mean `greeting`?\n"
    assert not (tmp_path / "never").exists()


def test_the_configuration_that_holds_is_printed_and_nothing_is_run(hello: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "robocomp_py.cli.rc",
        "run",
        str(hello),
        "--print-config",
        "--middleware",
        "inproc",
    ]
    variables = {"ROBOCOMP_RUNTIME_DIR": str(tmp_path / "never"), "ROBOCOMP__COMPONENT__PERIOD": "0.2"}
    run_it = partial(subprocess.run, capture_output=True, text=True, env=os.environ | variables)
    result = run_it([*command, "--set", "greeting=Hi"])
    assert (result.returncode, result.stderr) == (0, "")
    printed = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert 'middleware = "inproc" # --middleware inproc' in printed
    assert "period = 0.2 # environment variable ROBOCOMP__COMPONENT__PERIOD" in printed
    assert 'greeting = "Hi" # --set greeting=Hi' in printed
    assert not (tmp_path / "never").exists()
    as_json = run_it([*command, "--json"])
    assert {"key": "middleware", "value": "inproc", "from": "--middleware inproc"} in map(
        json.loads, as_json.stdout.splitlines()
    )
    wrong = run_it([*command, "--set", "greting=Hi"])
    assert (wrong.returncode, wrong.stdout) == (1, "")
    assert "did you mean `greeting`" in wrong.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (
            ["--middleware", "carrier-pigeon"],
            2,
            "unknown middleware `carrier-pigeon`; known: ",
        ),
        (["--config", "nowhere.toml"], 1, "nowhere.toml: cannot be read: No such file or directory"),
        (["--name", "two words"], 1, "'two words' is not a name for an instance"),
        (["--unknown"], 2, "no option --unknown; see: rc run hello --help"),
        (["--set", "transports.zeromq.prot=1"], 1, "unknown transport option 'prot'; known: bind"),
    ],
)
def test_a_wrong_option_is_said_in_a_sentence(hello: Path, arguments: list[str], code: int, message: str) -> None:
    result = run("robocomp_py.cli.rc", "run", str(hello), *arguments)
    assert result.returncode == code
    assert message in result.stderr
    assert "Traceback" not in result.stderr


def test_its_help_teaches(hello: Path) -> None:
    result = run("robocomp_py.cli.rc", "run", str(hello), "--help")
    assert result.returncode == 0
    for word in ("--config", "--name", "--middleware", "--set", "component.period=0.02"):
        assert word in result.stdout


def test_a_folder_without_a_component_is_an_error_with_the_remedy(tmp_path: Path) -> None:
    result = run("robocomp_py.cli.rc", "run", str(tmp_path))
    assert result.returncode == 1
    assert "is not a generated component" in result.stderr
    assert "run rcgen on its .cdsl" in result.stderr


def test_a_model_stands_for_the_folder_of_its_component(hello: Path) -> None:
    result = run("robocomp_py.cli.rc", "run", str(hello / "hello.cdsl"), "--help")
    assert result.returncode == 0
    assert "component.period=0.02" in result.stdout


def test_a_model_without_generated_code_is_an_error_with_the_remedy(tmp_path: Path) -> None:
    model = tmp_path / "arm.cdsl"
    model.write_text("Component Arm { language Python; };")
    result = run("robocomp_py.cli.rc", "run", str(model))
    assert result.returncode == 1
    assert f"is not a generated component: it has no generic/genericworker.py; run: rcgen {model}" in result.stderr


def test_another_file_of_a_component_is_an_error_with_the_remedy(hello: Path) -> None:
    result = run("robocomp_py.cli.rc", "run", str(hello / "specificworker.py"))
    assert result.returncode == 1
    assert "is a file, not a component; give the component's folder or its .cdsl" in result.stderr


def test_folders_of_the_same_name_do_not_mix(tmp_path: Path) -> None:
    from robocomp_py.runtime.load import load_worker

    workers: list[Any] = []
    for parent in ("a", "b"):
        folder = tmp_path / parent / "my-hello"
        assert rcgen(["--new", "Hello", "-o", str(folder)]) == 0
        workers.append(load_worker(folder))
    assert workers[0] is not workers[1]
    assert workers[0].__module__ != workers[1].__module__
    assert load_worker(tmp_path / "a" / "my-hello") is workers[0]


def test_a_folder_needs_no_init_file_to_be_a_component(tmp_path: Path) -> None:
    from robocomp_py.runtime.load import load_worker

    folder = tmp_path / "bare-hello"
    assert rcgen(["--new", "Hello", "-o", str(folder)]) == 0
    (folder / "__init__.py").unlink()
    worker = load_worker(folder)
    assert worker.__name__ == "SpecificWorker"
    assert load_worker(folder) is worker
    assert load_worker(folder, afresh=True) is not worker


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ("def compute(self)\n    pass\n", 'specificworker.py", line 1'),
        ("import no_such_library\n", "ModuleNotFoundError: No module named 'no_such_library'"),
    ],
)
def test_a_mistake_in_user_code_is_shown_without_the_frameworks_frames(tmp_path: Path, broken: str, said: str) -> None:
    folder = tmp_path / "hello"
    assert rcgen(["--new", "Hello", "-o", str(folder)]) == 0
    (folder / "specificworker.py").write_text(broken)
    result = run("robocomp_py.cli.rc", "run", str(folder))
    assert result.returncode == 1
    assert said in result.stderr
    assert len(result.stderr.splitlines()) < 9
    assert "runtime/load.py" not in result.stderr


def test_a_component_may_be_called_like_a_library(tmp_path: Path) -> None:
    folder = tmp_path / "zmq"
    assert rcgen(["--new", "Hello", "-o", str(tmp_path / "hello")]) == 0
    (tmp_path / "hello").rename(folder)
    with started("robocomp_py.cli.rc", "run", str(folder), cwd=tmp_path / "..") as process:
        process.send_signal(signal.SIGINT)
    assert process.returncode == 130


def test_a_closed_terminal_ends_in_finish(hello: Path) -> None:
    with started("robocomp_py.cli.rc", "run", str(hello)) as process:
        process.send_signal(signal.SIGHUP)
    assert process.returncode == 128 + signal.SIGHUP


STUCK = """    def compute(self) -> None:
        self.log.info("stuck")
        while True:
            pass
"""


def test_a_stuck_component_says_how_to_end_it(hello: Path) -> None:
    worker = hello / "specificworker.py"
    before = worker.read_text()
    worker.write_text(before.replace("    def compute(self) -> None:", STUCK, 1))
    try:
        with started("robocomp_py.cli.rc", "run", str(hello), "--grace", "999") as process:
            assert process.stderr is not None
            assert any("stuck" in line for line in process.stderr)
            process.send_signal(signal.SIGINT)
            told = next(line for line in process.stderr if "asked to stop" in line)
            assert "still busy with SpecificWorker.compute; press Ctrl-C again to end it now" in told
            assert "otherwise it is ended in 997 s" in told
            process.send_signal(signal.SIGINT)
            process.stderr.read()
    finally:
        worker.write_text(before)


@pytest.mark.parametrize("loop", ["while True:\n            pass", 're.match("(a+)+$", "a" * 64 + "b")'])
def test_a_stuck_component_is_ended_and_says_where_it_was(hello: Path, loop: str) -> None:
    worker = hello / "specificworker.py"
    before = worker.read_text()
    stuck = STUCK.replace("while True:\n            pass", f"import re; {loop}" if "re." in loop else loop)
    worker.write_text(before.replace("    def compute(self) -> None:", stuck, 1))
    try:
        with started("robocomp_py.cli.rc", "run", str(hello), "--grace", "0.1") as process:
            assert process.stderr is not None
            assert any("stuck" in line for line in process.stderr)
            process.send_signal(signal.SIGTERM)
            assert "in compute" in process.stderr.read()
    finally:
        worker.write_text(before)
    assert process.returncode == 1


def test_a_launcher_has_its_own_patience_with_what_it_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert (grace_of([None]), grace_of([None, 20.0])) == (5.0, 25.0)
    monkeypatch.setenv("NOTIFY_SOCKET", "/run/launcher")
    assert (grace_of([None]), grace_of([1.0])) == (None, 1.0)
