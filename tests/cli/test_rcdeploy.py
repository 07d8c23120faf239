"""`rcdeploy` as people use it: started, watched, stopped, killed."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.shm.room import prefix

from ..leftovers import killed_on_failure
from .programs import Program, alive, network_of, running

Said = pytest.CaptureFixture[str]

ASKER = """
import "../hello/Hello.idsl";
Component asker { Communications { requires Hello; }; language python; period 20 ms; };
"""
NETWORK = """
import "hello/hello.cdsl"; import "asker/asker.cdsl";
Deployment net {
    Component asker { dependences hello; };
    Component hello { };
};
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A server, a client, and their network."""
    root = tmp_path_factory.mktemp("deploy")
    assert rcgen(["--new", "Hello", "-o", str(root / "hello")]) == 0
    (root / "asker").mkdir()
    (root / "asker" / "asker.cdsl").write_text(ASKER)
    assert rcgen([str(root / "asker" / "asker.cdsl")]) == 0
    worker = root / "asker" / "specificworker.py"
    worker.write_text(
        worker.read_text()
        + '\n    def finish(self) -> None:\n        self.log.info("asked: %s", self.hello_proxy.greet("Ada"))\n'
    )
    (root / "net.ddsl").write_text(NETWORK)
    return root


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)


def test_a_network_is_started_in_order_run_for_a_while_and_stopped(folder: Path) -> None:
    result = run(folder / "net.ddsl", "--for", 0.3)
    assert result.returncode == 0, result.stdout + result.stderr
    said = result.stdout
    steps = ["hello │ ready", "asker │ ready", "both components of net are ready", "time limit reached", "Hello, Ada!"]
    assert [step for step in steps if step in said] == steps
    assert said.index("hello │ ready") < said.index("asker │ ready")
    assert said.index("time limit reached") < said.index("asked: Hello, Ada!"), (
        "a client stops while its server still lives"
    )


def test_the_middleware_can_be_chosen(folder: Path) -> None:
    assert run(folder / "net.ddsl", "--middleware", "zeromq", "--for", 0).returncode == 0
    wrong = run(folder / "net.ddsl", "--middleware", "zeromk", "--for", 0)
    assert wrong.returncode == 2
    assert wrong.stderr == "rcdeploy: --middleware zeromk: no middleware `zeromk`; did you mean `zeromq`?\n"
    assert wrong.stdout == ""


def test_an_option_is_blamed_for_a_middleware_that_stays_in_a_process(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rcdeploy([str(folder / "net.ddsl"), "--middleware", "inproc"]) == 1
    assert "error[unfit-middleware]: --middleware inproc: `inproc` does not reach other" in capsys.readouterr().err


def test_the_launcher_of_a_network_is_notified_of_ready_and_stopping(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as told:
        told.bind(str(tmp_path / "told"))
        told.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "told"))
        assert run(folder / "net.ddsl", "--for", 0).returncode == 0
        assert [told.recv(100), told.recv(100)] == [b"READY=1", b"STOPPING=1"]
        with pytest.raises(BlockingIOError):
            told.recv(100)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_stops_everything(folder: Path, number: int, code: int) -> None:
    with running("rcdeploy", folder / "net.ddsl") as deployer:
        deployer.wait_for("are ready")
        deployer.send_signal(number)
    assert deployer.returncode == code
    assert any("asked: Hello, Ada!" in line for line in deployer.lines)


def test_a_mission_that_ends_ends_the_network(folder: Path) -> None:
    path = network_of(folder, "programs", mission="sleep 0.2; echo accomplished", helper="exec sleep 600")
    result = run(path, "--until", "mission")
    assert result.returncode == 0, result.stdout
    assert "mission │ accomplished" in result.stdout
    assert "stopping: mission has ended" in result.stdout


def test_a_failure_is_printed_once_and_what_led_to_it_too(folder: Path) -> None:
    breaks = "echo about to break; while ! [ -e break ]; do sleep 0.02; done; exit 3"
    path = network_of(folder, "programs", fragile=breaks, sturdy="exec sleep 600")
    with running("rcdeploy", path) as deployer:
        deployer.wait_for("are ready")
        (folder / "break").touch()
        deployer.wait_for("fragile ended with exit code 3")
        deployer.send_signal(signal.SIGINT)
    said = "\n".join(deployer.lines)
    assert (said.count("about to break"), said.count("ended with exit code 3")) == (1, 1)
    assert deployer.returncode == 1


def test_a_component_that_cannot_start_stops_the_network(folder: Path) -> None:
    worker = folder / "hello" / "specificworker.py"
    before = worker.read_text()
    worker.write_text(before.replace("self.greeted = 0", "raise OSError('no such device')"))
    try:
        result = run(folder / "net.ddsl")
    finally:
        worker.write_text(before)
    assert result.returncode == 1
    assert "no such device" in result.stdout
    assert "asker │" not in result.stdout


def test_a_program_that_cannot_be_started_fails_with_the_reason(folder: Path) -> None:
    path = network_of(folder, "programs", broken="")
    (folder / "broken.sh").write_text("#!/no/such/interpreter\n")
    result = run(path)
    assert result.returncode == 1
    assert "broken.sh cannot be started: No such file or directory" in result.stdout


def test_a_second_signal_kills_what_does_not_stop(folder: Path) -> None:
    path = network_of(folder, "programs", stubborn="trap '' TERM; echo here; while true; do sleep 0.1; done")
    with running("rcdeploy", path) as deployer:
        deployer.wait_for("here")
        deployer.send_signal(signal.SIGINT)
        deployer.wait_for("stopping")
        deployer.send_signal(signal.SIGINT)  # no patience for its grace
    assert deployer.returncode == 130
    assert any("stubborn was killed" in line for line in deployer.lines)


def test_the_demonstration_generates_nothing_for_a_middleware_that_stays_in_a_process() -> None:
    demo = Path(__file__).parents[2] / "components" / "demo.py"
    command = [sys.executable, str(demo), "--middleware", "inproc"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=SOON * 6)
    assert (result.returncode, result.stdout) == (2, "")
    assert "`inproc` does not reach other processes" in result.stderr


def test_a_failure_before_all_are_ready_ends_the_start(folder: Path) -> None:
    """The client would wait for its server for a minute."""
    path = folder / "half.ddsl"
    path.write_text(
        'import "hello/hello.cdsl"; import "asker/asker.cdsl";'
        'Deployment half { Component hello { path "/bin/false"; }; Component asker { }; };'
    )
    result = run(path, "--set", f"asker.component.startup_timeout={SOON * 100}")
    assert result.returncode == 1
    assert "hello ended with exit code 1" in result.stdout
    assert "stopping: hello ended before all components were ready" in result.stdout


def test_components_must_be_generated_from_what_their_models_are_now(tmp_path: Path) -> None:
    assert rcgen(["--new", "Hello", "-o", str(tmp_path / "hello")]) == 0
    path = tmp_path / "net.ddsl"
    path.write_text('import "hello/hello.cdsl"; Deployment net { Component hello { }; };')
    assert rcdeploy(["plan", str(path)]) == 0
    idsl = tmp_path / "hello" / "Hello.idsl"
    idsl.write_text(idsl.read_text().replace("greet(", "welcome("))
    result = run(path)
    assert result.returncode == 1
    assert "error[out-of-date]: `hello` is not generated from its models as they are now" in result.stderr
    assert f"run: rcgen {path}" in result.stderr
    assert rcgen([str(path)]) == 0
    assert "error[missing-handler]: `SpecificWorker` lacks `Hello_welcome`" in run(path).stderr
    assert rcgen(["--stubs", str(path)]) == 0
    assert rcdeploy(["plan", str(path)]) == 0


def test_a_program_of_ones_own_need_not_be_generated(tmp_path: Path) -> None:
    assert rcgen(["--new", "Hello", "-o", str(tmp_path / "hello")]) == 0
    (tmp_path / "hello" / "generic" / "genericworker.py").unlink()
    path = tmp_path / "net.ddsl"
    path.write_text('import "hello/hello.cdsl"; Deployment net { Component hello { path "/bin/true"; }; };')
    assert rcdeploy(["plan", str(path)]) == 0


def test_characters_that_the_output_lacks_are_replaced(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    result = run(network_of(folder, "programs", polite="echo 'buenos días'"))
    assert result.returncode == 0, result.stderr
    assert "polite | buenos d?as" in result.stdout
    assert "Traceback" not in result.stderr


def run_without_room(*arguments: object) -> subprocess.CompletedProcess[str]:
    """With an output that takes nothing."""
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", *map(str, arguments)]
    with open("/dev/full", "w") as full:
        return subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=SOON * 6)


def test_a_network_goes_on_when_its_output_cannot_be_written(folder: Path) -> None:
    path = network_of(folder, "programs", worker="echo one; echo two; touch went-on")
    result = run_without_room(path)
    assert (folder / "went-on").exists()
    assert result.returncode == 0
    assert (
        result.stderr == "rcdeploy: output is lost from here on; the network keeps running: No space left on device\n"
    )


def test_a_network_needs_no_output(folder: Path) -> None:
    path = network_of(folder, "programs", worker="echo one; touch without-output")
    command = ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(path)]
    result = subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=SOON * 6)
    assert (result.returncode, result.stderr) == (0, "")
    assert (folder / "without-output").exists()


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_a_plan_that_cannot_be_written_is_a_failure(folder: Path, options: list[str]) -> None:
    result = run_without_room("plan", folder / "net.ddsl", *options)
    assert result.returncode == 1
    assert result.stderr == "rcdeploy: the plan cannot be written: No space left on device\n"


@pytest.mark.parametrize("module", ["lark", "rich.console", "robocomp_py.deploy.plan", "asyncio"])
def test_an_interrupt_while_modules_are_imported_ends_it_quietly(folder: Path, module: str) -> None:
    code = f"""
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from robocomp_py.cli.rcdeploy import main
sys.exit(main([{str(folder / "net.ddsl")!r}]))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=SOON * 6)
    assert (result.returncode, result.stderr) == (130, "")


def test_what_a_component_started_ends_with_it(folder: Path) -> None:
    path = network_of(folder, "programs", parent="sleep 600 & echo child $!; exec sleep 600")
    with running("rcdeploy", path) as deployer:
        deployer.wait_for("child")
        child = int(next(line for line in deployer.lines if "child" in line).split()[-1])
        assert alive(child)
        deployer.send_signal(signal.SIGINT)
    wait_until(lambda: not alive(child))


def test_no_process_survives_a_killed_deployer_and_nothing_is_left(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    path = network_of(
        folder,
        "programs",
        parent="echo parent $$; sleep 600 & echo child $!; exec sleep 600",
        stubborn="trap '' TERM HUP; echo stubborn $$; while true; do sleep 0.1; done",
    )
    with running("rcdeploy", path) as deployer:
        for word in ("parent │ parent", "child", "stubborn │ stubborn"):
            deployer.wait_for(word)
        pids = [int(line.split()[-1]) for line in deployer.lines if line.split()[-1].isdigit()]
        assert len(pids) == 3
        assert all(map(alive, pids))
        deployer.kill()
    wait_until(lambda: not any(map(alive, pids)), SOON * 2)
    wait_until(lambda: not list(tmp_path.iterdir()))


@pytest.fixture
def run_time(runtime_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A run-time folder of its own, and what a library keeps elsewhere for it."""
    with tempfile.TemporaryDirectory(dir=runtime_folder) as made:
        monkeypatch.setenv("ROBOCOMP_RUNTIME_DIR", made)
        yield Path(made)


def left_in(run_time: Path) -> set[str]:
    """What is there but folders and logs."""
    inside = {str(each.relative_to(run_time)) for each in run_time.rglob("*") if not each.is_dir()}
    shared = {str(each) for each in Path("/dev/shm").glob(f"{prefix(run_time / 'shm')}*")}
    return {each for each in inside | shared if not each.startswith("deploy/net/logs/")}


def killed(*arguments: object, too: bool = False) -> Program:
    """A network whose components were all killed at once, and who ran it as well, if so."""
    with running("rcdeploy", *arguments) as deployer:
        deployer.wait_for("are ready")
        found = json.loads(run("status", "net", "--json").stdout)
        if too:
            deployer.send_signal(signal.SIGSTOP)  # it would end by itself if it saw them go
        for pid in (*(each["pid"] for each in found["processes"]), *([deployer.pid] if too else ())):
            os.kill(pid, signal.SIGKILL)
    return deployer


@pytest.mark.parametrize("middleware", ["auto", "zeromq"])  # `auto` takes shm on one host
def test_killed_components_leave_no_more_files_than_those_that_end_normally(
    folder: Path, run_time: Path, middleware: str
) -> None:
    assert run(folder / "net.ddsl", "--middleware", middleware, "--for", 0).returncode == 0
    before = left_in(run_time)
    assert before <= {"shm/nodes.lock"}
    assert killed(folder / "net.ddsl", "--middleware", middleware).returncode == 1
    assert left_in(run_time) == before


def test_components_that_are_killed_with_their_launcher_leave_no_files(folder: Path, run_time: Path) -> None:
    assert killed(folder / "net.ddsl", too=True).returncode == -signal.SIGKILL
    wait_until(lambda: left_in(run_time) <= {"shm/nodes.lock"})


def test_components_of_a_killed_deployer_still_finish(folder: Path) -> None:
    log = folder / "finished"
    worker = folder / "asker" / "specificworker.py"
    before = worker.read_text()
    worker.write_text(
        before.replace("        self.log.info(", f"        open({str(log)!r}, 'w').close()\n        self.log.info(")
    )
    try:
        with running("rcdeploy", folder / "net.ddsl") as deployer:
            deployer.wait_for("are ready")
            deployer.kill()
        wait_until(log.exists)
    finally:
        worker.write_text(before)


def test_a_flood_of_output_and_endless_lines_are_passed_on(folder: Path) -> None:
    path = network_of(
        folder, "programs", noisy="head -c 300000 /dev/zero | tr '\\0' x; echo; yes | head -n 2000; printf last"
    )
    result = run(path)
    assert result.returncode == 0
    assert result.stdout.count("x") >= 300_000
    assert result.stdout.count("│ y\n") == 2000
    assert "noisy │ last" in result.stdout


def test_nothing_starts_while_anything_is_wrong(folder: Path) -> None:
    path = network_of(folder, "programs", innocent="touch innocent-was-here")
    path.write_text(path.read_text().replace("};\n};", "};\n    Component ghost { };\n};"))
    result = run(path)
    assert result.returncode == 1
    assert "error[unknown-component]" in result.stderr
    assert not (folder / "innocent-was-here").exists()


def test_the_plan_shows_what_would_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy(["plan", str(folder / "net.ddsl")]) == 0
    said = capsys.readouterr().out
    for word in ("hello", "asker", "Hello of hello", "--name asker"):
        assert word in said


def test_a_command_that_the_plan_prints_runs_as_the_network_would_run_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = network_of(folder, "programs", program='echo "$MOOD in $PWD"')
    path.write_text(path.read_text().replace('path "', 'env MOOD "it\'s $(fine)"; path "'))
    monkeypatch.chdir(tmp_path)
    assert rcdeploy(["plan", str(path)]) == 0
    (line,) = (each for each in capsys.readouterr().out.splitlines() if each.startswith("program: "))
    shell = subprocess.run(["sh", "-c", line.partition(": ")[2]], capture_output=True, text=True)
    assert shell.stdout == f"it's $(fine) in {folder.resolve()}\n"


def test_the_plan_can_be_read_by_machines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy(["plan", str(folder / "net.ddsl"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [each["name"] for each in found["processes"]] == ["hello", "asker"]
    assert found["links"] == [
        {"interface": "Hello", "provider": "hello", "client": "asker", "verb": "requires", "named": ""}
    ]


def test_what_is_wrong_with_a_plan_can_be_read_by_machines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "wrong.ddsl"
    path.write_text('import "hello/hello.cdsl"; Deployment wrong { Component hullo { }; };')
    assert rcdeploy(["plan", str(path), "--json"]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["code"] == "unknown-component"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give it one network"),
        (["plan"], "rcdeploy plan: error: NET.ddsl is missing"),
        (["one.ddsl", "two.ddsl", "three.ddsl"], "give it one network"),
        (["net.ddsl", "--for", "soon"], "--for: `soon` is not a number of seconds"),
        (["net.ddsl", "--for", "-1"], "--for: `-1` is not a number of seconds"),
        (["--set", "x", "net.ddsl"], "--set x: write it as INSTANCE.KEY=VALUE"),
        (["paln", "net.ddsl"], "no command `paln`; did you mean `plan`?"),
        (["kill", "net"], "no command `kill`; did you mean `down`?"),
        (["net.ddsl", "simulate", "--for", "1"], "the command comes first: rcdeploy simulate net.ddsl"),
        (["ps"], "no command `ps`; did you mean `status`?"),
        (["net.ddsl", "--json"], "--json is for `rcdeploy plan`"),
        (["plan", "net.ddsl", "--for", "1"], "not for `rcdeploy plan`"),
    ],
)
def test_wrong_usage_exits_with_2(
    folder: Path,
    arguments: list[str],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    try:
        code: object = rcdeploy(arguments)
    except SystemExit as exc:
        code = exc.code
    assert code == 2
    assert says in capsys.readouterr().err


def test_options_may_stand_anywhere(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(folder / "net.ddsl")
    for arguments in (["-I", "x", "plan", path], ["plan", "-I", "x", path], ["plan", path, "-I", "x"]):
        assert rcdeploy(arguments) == 0


def test_an_unknown_mission_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy([str(folder / "net.ddsl"), "--until", "victory"]) == 2
    assert "unknown instance `victory`" in capsys.readouterr().err


def test_its_help_teaches(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        rcdeploy(["--help"])
    said = capsys.readouterr().out
    for word in ("--middleware", "--for", "--until", "--set", "rcdeploy plan", "examples:"):
        assert word in said


def test_on_a_terminal_states_are_shown_live(folder: Path) -> None:
    """Run on a pseudo-terminal, as a person would see it."""
    import pty

    master, slave = pty.openpty()
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", str(folder / "net.ddsl"), "--for", "0.2"]
    seen = b""
    with killed_on_failure(command, stdout=slave, stderr=slave, env=os.environ | {"TERM": "xterm-256color"}) as process:
        os.close(slave)
        while True:
            try:
                seen += os.read(master, 65536)
            except OSError:
                break
        os.close(master)
    assert process.returncode == 0
    for word in (b"starting", b"ready", b"stopping", b"\x1b["):
        assert word in seen


@pytest.mark.parametrize(
    ("variable", "value", "option"),
    [
        ("ROBOCOMP__COMPONENT__PERIOD", "soon", ""),
        ("ROBOCOMP__COMPONENT__PERIOOD", "1", ""),
        ("ROBOCOMP__MIDDLEWARE", "zenho", ""),
        ("OTHER", "", "*.component.period=soon"),
    ],
)
def test_errors_outside_all_files_are_reported_once_without_a_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said, variable: str, value: str, option: str
) -> None:
    monkeypatch.setenv(variable, value)
    assert rcdeploy(["plan", str(folder / "net.ddsl"), *(["--set", option] if option else [])]) == 1
    said = capsys.readouterr().err
    origin = f"--set {option}" if option else f"environment variable {variable}"
    assert said.startswith(f"{origin}: error[")
    assert said.count("error[") == 1
    assert "(for `hello`, `asker`)" in said
    assert "net.ddsl" not in said
