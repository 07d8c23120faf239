"""`rcdeploy simulate` as people use it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.errors import DeploymentError
from robocomp_py.testing.patience import SOON
from robocomp_py.testing.simulation import Simulation

Said = pytest.CaptureFixture[str]

NETWORK = """
import "hello/hello.cdsl"; import "asker/asker.cdsl";
Deployment net {
    Component asker { };
    Component hello { };
};
"""
ASKER = """
import "../hello/Hello.idsl";
Component asker { Communications { requires Hello; }; language python; period 20 ms; };
"""


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A server, a client and their network."""
    root = tmp_path_factory.mktemp("simulate")
    assert rcgen(["--new", "Hello", "-o", str(root / "hello")]) == 0
    (root / "asker").mkdir()
    (root / "asker" / "asker.cdsl").write_text(ASKER)
    assert rcgen([str(root / "asker" / "asker.cdsl")]) == 0
    compute(root, "self.hello_proxy.greet(str(self.now()))")
    (root / "net.ddsl").write_text(NETWORK)
    return root


@pytest.fixture
def folder(generated: Path, tmp_path: Path) -> Path:
    """The same, for one test."""
    shutil.copytree(generated, tmp_path, dirs_exist_ok=True)
    return tmp_path


def compute(folder: Path, *lines: str, imports: str = "") -> None:
    """Let the client do this every period."""
    worker = folder / "asker" / "specificworker.py"
    head = (
        worker.read_text().partition("class SpecificWorker")[0].replace(" annotations\n", f" annotations\n{imports}", 1)
    )
    body = "".join(f"        {line}\n" for line in lines)
    worker.write_text(f"{head}class SpecificWorker(GenericWorker):\n    def compute(self) -> None:\n{body}")


def simulate(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", "simulate", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=SOON * 6, env={**os.environ, **environment}, check=False
    )


def test_a_network_runs_and_says_how_fast_and_what_hash(folder: Path) -> None:
    done = simulate(folder / "net.ddsl", "--for", 10)
    assert done.returncode == 0, done.stderr
    speed, result = done.stdout.splitlines()
    assert speed.startswith("net: 10 s in ")
    assert speed.endswith(" times as fast as real time")
    assert result.startswith("1002 messages, hash ")
    assert "    0.000 hello INFO: ready\n" in done.stderr


def test_two_processes_say_the_same_whatever_their_order_of_sets(folder: Path) -> None:
    runs = [simulate(folder / "net.ddsl", "--for", 2, "--json", PYTHONHASHSEED=seed) for seed in ("1", "2")]
    first, second = (json.loads(each.stdout) for each in runs)
    assert first["hash"] == second["hash"]
    assert first.keys() == {"seconds", "took", "messages", "hash", "failed", "errors"}


def test_a_trace_has_a_line_for_each_message(folder: Path) -> None:
    trace = folder / "trace.jsonl"
    assert simulate(folder / "net.ddsl", "--for", 0.02, "--trace", trace).returncode == 0
    lines = [json.loads(line) for line in trace.read_text().splitlines()]
    assert [(line["ns"], line["kind"]) for line in lines] == [
        *((0, "query"), (0, "ok")),
        *((20_000_000, "query"), (20_000_000, "ok")),
    ]
    assert lines[2]["from"] == "asker"
    assert lines[2]["to"] == "hello/Hello/greet"
    assert lines[2]["values"] == {"name": "20000000"}


def test_check_says_that_two_runs_are_the_same(folder: Path) -> None:
    done = simulate(folder / "net.ddsl", "--for", 1, "--check")
    assert (done.stdout, done.returncode) == ("both runs said the same: 102 messages\n", 0)


def test_an_exception_in_a_handler_is_a_failure_at_the_end_of_the_run(folder: Path) -> None:
    worker = folder / "hello" / "specificworker.py"
    head = "    def Hello_greet(self, name: str) -> str:\n"
    failing = "        if name == '20000000':\n            raise ValueError('too late')\n"
    worker.write_text(worker.read_text().replace(head, head + failing))
    lines = "with contextlib.suppress(RemoteFailure):", "    self.hello_proxy.greet(str(self.now()))"
    compute(folder, *lines, imports="import contextlib\nfrom robocomp_py.errors import RemoteFailure\n")
    done = simulate(folder / "net.ddsl", "--for", 1)
    assert done.returncode == 1
    assert done.stdout.startswith("net: 1 s in ")
    assert done.stdout.endswith("\nexceptions in the code of hello; see the log above\n")
    done = simulate(folder / "net.ddsl", "--for", 1, "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 1
    assert (result["seconds"], result["failed"]) == (1.0, [])
    what = {"instance": "hello", "method": "SpecificWorker.Hello_greet", "exception": "ValueError: too late"}
    assert result["errors"] == [{"time": 0.02, **what}]
    done = simulate(folder / "net.ddsl", "--for", 1, "--check")
    assert (done.returncode, done.stdout) == (1, "both runs said the same: 102 messages\n")


def test_check_names_the_sender_that_reads_the_time_of_day(folder: Path) -> None:
    compute(folder, "self.hello_proxy.greet(str(time.time_ns()))", imports="import time\n")
    done = simulate(folder / "net.ddsl", "--for", 1, "--check")
    assert done.returncode == 1
    assert done.stdout.startswith("the runs differ from message 1 on:\n")
    assert "asker depends on something that is not part of the simulation" in done.stdout


def test_a_component_that_fails_ends_the_run(folder: Path) -> None:
    compute(folder, "if self.now():", "    raise ValueError('broken')")
    done = simulate(folder / "net.ddsl", "--for", 1)
    assert done.returncode == 1
    assert "broken" in done.stderr
    assert done.stdout.startswith("net: 0.02 s in ")
    assert done.stdout.endswith("\nended by a failure of asker; see its log above\n")


def test_a_handler_that_fails_is_logged_with_its_instance(folder: Path) -> None:
    worker = folder / "hello" / "specificworker.py"
    worker.write_text(worker.read_text().replace("self.greeted += 1", "raise ValueError('broken')"))
    done = simulate(folder / "net.ddsl", "--for", 0)
    assert "    0.000 hello ERROR: SpecificWorker.Hello_greet raised ValueError\n" in done.stderr


def test_a_thread_of_a_component_is_a_warning(folder: Path) -> None:
    compute(
        folder,
        'if not hasattr(self, "thread"):',
        "    self.end = threading.Event()",
        '    self.thread = threading.Thread(target=self.end.wait, name="driver", daemon=True)',
        "    self.thread.start()",
        imports="import threading\n",
    )
    done = simulate(folder / "net.ddsl", "--for", 1)
    assert done.returncode == 0
    assert done.stderr.count("a component has started the thread `driver`") == 1


def test_an_instance_that_does_not_end_in_time_is_an_error(folder: Path, capsys: Said) -> None:
    assert rcdeploy(["simulate", str(folder / "net.ddsl"), "--until", "asker", "--for", "0.1"]) == 1
    assert "asker has not ended in 0.1 s" in capsys.readouterr().err


def simulated(said: Said, folder: Path, *arguments: object) -> dict[str, Any]:
    """The result of a run in this process."""
    assert rcdeploy(["simulate", str(folder / "net.ddsl"), "--json", *map(str, arguments)]) == 0
    result: dict[str, Any] = json.loads(said.readouterr().out)
    return result


def test_a_run_ends_when_an_instance_has_ended(folder: Path, capsys: Said) -> None:
    compute(folder, "if self.now() >= 400_000_000:", "    self.stop()")
    assert simulated(capsys, folder, "--until", "asker", "--for", 60)["seconds"] == 0.4


def test_instances_of_one_name_in_several_systems_are_told_apart(folder: Path, capsys: Said) -> None:
    compute(folder, 'self.hello_proxy.greet("Ada")', "if self.now() >= 400_000_000:", "    self.stop()")
    systems = (
        "System left { Component asker { }; }; System right { Component asker { }; Component other : asker { }; };"
    )
    (folder / "net.ddsl").write_text(NETWORK.replace("Component asker { };", systems))
    with Simulation(folder / "net.ddsl") as sim:
        assert sim.run(0.2)
        assert [sim[f"{each}/asker"].computes for each in ("left", "right")] == [11, 11]
        assert not sim.failed
    trace = folder / "trace.jsonl"
    assert simulated(capsys, folder, "--until", "right/asker", "--for", 60, "--trace", trace)["seconds"] == 0.4
    senders = [json.loads(line).get("from") for line in trace.read_text().splitlines()]
    assert set(senders) == {None, "left/asker", "right/asker", "right/other"}
    done = simulate(folder / "net.ddsl", "--for", 0)
    for each in ("left/asker", "right/asker", "right/other", "hello"):
        assert f"    0.000 {each} INFO: ready\n" in done.stderr


def test_a_run_at_a_speed_takes_its_time_and_says_the_same(folder: Path, capsys: Said) -> None:
    paced, quick = (simulated(capsys, folder, "--for", 0.6, "--speed", speed) for speed in (2, "max"))
    assert paced["took"] >= 0.3
    assert (paced["hash"], paced["seconds"]) == (quick["hash"], 0.6)


def test_a_difference_between_two_versions_is_seen_in_their_traces(folder: Path, capsys: Said) -> None:
    traces = []
    for greeting in ("str(self.now())", "str(self.now()).replace('4', '5')"):
        compute(folder, f"self.hello_proxy.greet({greeting})")
        traces.append(folder / f"{len(traces)}.jsonl")
        simulated(capsys, folder, "--for", 0.1, "--trace", traces[-1])
    old, new = (trace.read_text().splitlines() for trace in traces)
    differing = [json.loads(line) for before, line in zip(old, new, strict=True) if before != line]
    assert [(line["ns"], line["kind"]) for line in differing] == [(40_000_000, "query"), (40_000_000, "ok")]


def test_wrong_words_are_told_before_anything_starts(folder: Path, capsys: Said) -> None:
    network = str(folder / "net.ddsl")
    for words, why in (
        (["--until", "askar"], "did you mean `asker`?"),
        (["--check"], "--check needs --for or --until"),
    ):
        assert rcdeploy(["simulate", network, *words]) == 2
        assert why in capsys.readouterr().err
    for words, why in (
        (["--seed", "-1"], "`-1` is not a seed"),
        (["--speed", "0"], "`0` is not a speed"),
        (["--for", "soon"], "`soon` is not a number of seconds"),
    ):
        with pytest.raises(SystemExit):
            rcdeploy(["simulate", network, *words])
        assert why in capsys.readouterr().err
    assert rcdeploy(["simulate", network, "--for", "1", "--trace", str(folder / "no" / "trace")]) == 1
    assert "No such file or directory" in capsys.readouterr().err


def test_what_has_a_time_of_its_own_is_refused(folder: Path, capsys: Said) -> None:
    (folder / "program.cdsl").write_text("Component program { language python; };")
    (folder / "own.ddsl").write_text(
        'import "program.cdsl"; import "hello/hello.cdsl";\n'
        'Deployment own { Component driver : program { existing "/bin/true"; };\n'
        'host far { address "192.0.2.77"; };\n'
        'Component hello { env DISPLAY ":0"; };\n'
        "Component distant : hello { host far; }; };"
    )
    assert rcdeploy(["simulate", str(folder / "own.ddsl"), "--for", "1"]) == 1
    said = capsys.readouterr().err
    assert "driver: `path` and `existing` are programs with a time of their own" in said
    assert "distant: a simulation runs in one process, so no component may have a `host`" in said
    assert "hello: a simulation is one process, so no component may have an `env` of its own" in said


def test_a_network_that_is_wrong_is_told_as_on_the_command_line(folder: Path) -> None:
    with pytest.raises(DeploymentError) as raised:
        Simulation(folder / "net.ddsl", settings=[("askr", "component.period=0.5")])
    assert "error[unknown-instance]: unknown instance `askr`; did you mean `asker`?" in str(raised.value)


def test_a_test_of_a_network_needs_no_waiting(folder: Path) -> None:
    with Simulation(folder / "net.ddsl", settings=[("asker", "component.period=0.5")]) as sim:
        assert sim.run(3600.0)
        assert sim["asker"].computes == 7201
        assert sim["asker"].worker.period == 0.5
