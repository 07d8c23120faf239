// Where the language server is looked for, and what users are told.

import assert from "node:assert/strict";
import { test } from "node:test";
import { ended, findServer, installCommand, missing, type Surroundings } from "../src/server";

const HERE: Surroundings = {
    folders: ["/open/a", "/open/b"],
    path: "/usr/bin:relative::/opt/bin",
    home: "/home/ada",
    windows: false,
    isProgram: () => false,
};

function having(...programs: string[]): Surroundings {
    return { ...HERE, isProgram: (path) => programs.includes(path) };
}

const WINDOWS: Surroundings = { ...HERE, folders: ["C:\\work"], path: "C:\\bin;D:\\tools", home: "C:\\ada", windows: true };

test("a bare name is looked for in the folders' environments, then in PATH", () => {
    assert.deepEqual(findServer("rc", HERE).candidates, [
        "/open/a/.venv/bin/rc",
        "/open/b/.venv/bin/rc",
        "/usr/bin/rc",
        "/opt/bin/rc",
    ]);
});

test("the first that is there is taken", () => {
    assert.equal(findServer("rc", having("/usr/bin/rc", "/open/b/.venv/bin/rc")).program, "/open/b/.venv/bin/rc");
    assert.equal(findServer("rc", having("/opt/bin/rc")).program, "/opt/bin/rc");
    assert.equal(findServer("rc", HERE).program, undefined);
});

test("without trusted folders only PATH is searched", () => {
    assert.deepEqual(findServer("rc", { ...HERE, folders: [] }).candidates, ["/usr/bin/rc", "/opt/bin/rc"]);
});

test("a path is taken as it is, from home, or from the folders", () => {
    assert.deepEqual(findServer("/opt/rc", HERE).candidates, ["/opt/rc"]);
    assert.deepEqual(findServer("~/env/bin/rc", HERE).candidates, ["/home/ada/env/bin/rc"]);
    assert.deepEqual(findServer("env/bin/rc", HERE).candidates, ["/open/a/env/bin/rc", "/open/b/env/bin/rc"]);
});

test("an empty setting means the default", () => {
    assert.deepEqual(findServer("  ", HERE), findServer("rc", HERE));
});

test("on Windows environments have other folders, and programs an ending", () => {
    assert.deepEqual(findServer("rc", WINDOWS).candidates, [
        "C:\\work\\.venv\\Scripts\\rc.exe",
        "C:\\bin\\rc.exe",
        "D:\\tools\\rc.exe",
    ]);
    assert.deepEqual(findServer("D:\\rc.cmd", WINDOWS).candidates, ["D:\\rc.cmd"]);
});

test("what is missing is installed into the environment of the program that misses it", () => {
    const around = having("/open/a/.venv/bin/python", "/with space/bin/python");
    assert.equal(
        installCommand("/open/a/.venv/bin/rc", around),
        "/open/a/.venv/bin/python -m pip install 'robocomp-py[lsp]'",
    );
    assert.equal(
        installCommand("/with space/bin/rc", around),
        "'/with space/bin/python' -m pip install 'robocomp-py[lsp]'",
    );
});

test("without an environment, pip has to do", () => {
    assert.equal(installCommand(undefined, HERE), "pip install 'robocomp-py[lsp]'");
    assert.equal(installCommand("/opt/bin/rc", HERE), "pip install 'robocomp-py[lsp]'");
    assert.equal(installCommand(undefined, WINDOWS), 'pip install "robocomp-py[lsp]"');
});

test("who misses the program is told where it should be, and how to get it", () => {
    assert.match(missing("rc").message, /`rc` is neither in a \.venv of the workspace nor in PATH/);
    assert.match(missing("/opt/rc").message, /`\/opt\/rc` is not a program/);
    assert.match(missing("rc").message, /pip install 'robocomp-py\[lsp\]'/);
    assert.ok(missing("rc").install);
});

test("who misses the extra is told how to get it", () => {
    const said = "rc lsp: the language server needs pygls; run: pip install 'robocomp-py[lsp]'\n";
    const advice = ended("/opt/bin/rc", said, false);
    assert.match(advice.message, /pip install 'robocomp-py\[lsp\]'/);
    assert.ok(advice.install);
});

test("of any other end, the last words are told", () => {
    const advice = ended("/usr/bin/rc", "first\n  rc: cannot find `lsp'\n\n", false);
    assert.equal(advice.message, "RoboComp: `/usr/bin/rc lsp` did not start: rc: cannot find `lsp'");
    assert.ok(!advice.install);
    assert.equal(ended("rc", "", true).message, "RoboComp: `rc lsp` keeps failing");
});
