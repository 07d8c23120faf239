// The extension as it is shipped, in a small imitation of VS Code, with servers that are scripts.

import assert from "node:assert/strict";
import { chmodSync, mkdirSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { afterEach, beforeEach, test } from "node:test";
import { Editor } from "./editor";
import { EXTENSION } from "./textmate";

const PATH = process.env["PATH"];
let folder: string;

beforeEach(() => {
    folder = mkdtempSync(join(tmpdir(), "robocomp-"));
    process.env["PATH"] = join(folder, "bin");
});

afterEach(() => {
    process.env["PATH"] = PATH;
    rmSync(folder, { recursive: true });
});

/** A program called rc, in the environment of the workspace if not elsewhere. */
function program(text: string, where = ".venv/bin"): string {
    mkdirSync(join(folder, where), { recursive: true });
    const path = join(folder, where, "rc");
    writeFileSync(path, text);
    chmodSync(path, 0o755);
    return path;
}

const SERVER = `#!/bin/sh\nexec ${process.execPath} ${join(EXTENSION, "test", "fixtures", "server.js")}\n`;

test("the server of the workspace's environment is started, and stopped in the end", async () => {
    const path = program(SERVER);
    const editor = new Editor(folder, { include: ["interfaces"] });
    await editor.open();
    await editor.sees(/asked: initialized/);
    assert.ok(editor.logged.includes(`${path} lsp`));
    assert.match(await editor.sees(/asked: initialize /), /\{"include":\["interfaces"\]\}/);
    await editor.close();
    await editor.sees(/asked: exit/);
    assert.deepEqual(editor.messages, []);
});

test("it can be started anew", async () => {
    program(SERVER);
    const editor = new Editor(folder);
    await editor.open();
    await editor.commands.get("robocomp.restartServer")?.();
    assert.equal(editor.logged.filter((each) => each.endsWith("rc lsp")).length, 2);
    await editor.close();
    assert.deepEqual(editor.messages, []);
});

test("without a server, a user is told how to get one, and may have it typed", async () => {
    const editor = new Editor(folder);
    editor.press = "Install…";
    await editor.open();
    const { text, buttons } = await editor.told();
    assert.match(text, /`rc` is neither in a \.venv of the workspace nor in PATH/);
    assert.deepEqual(buttons, ["Install…", "Change the setting"]);
    assert.deepEqual(editor.typed, ["pip install 'robocomp-py[lsp]'"]);
    await editor.close();
});

test("without the extra, a user is told so, once", async () => {
    program("#!/bin/sh\necho \"rc lsp: the language server needs pygls; run: pip install 'robocomp-py[lsp]'\" >&2\nexit 1\n");
    const editor = new Editor(folder);
    await editor.open();
    assert.match((await editor.told()).text, /is not installed: pip install 'robocomp-py\[lsp\]'/);
    await editor.close();
    assert.equal(editor.messages.length, 1);
});

test("of a program that is something else, a user sees the last words, and may see the log", async () => {
    program("#!/bin/sh\necho \"rc: cannot find $1\" >&2\nexit 1\n", "bin");
    const editor = new Editor(folder);
    editor.press = "Show the log";
    await editor.open();
    assert.match((await editor.told()).text, /did not start: rc: cannot find lsp$/);
    await editor.sees(/^shown$/);
    await editor.close();
});

test("a file that cannot be run is told of", async () => {
    program("#!/nowhere/sh\n", "bin");
    const editor = new Editor(folder);
    await editor.open();
    assert.match((await editor.told()).text, /did not start: Error: spawn .* ENOENT$/);
    await editor.close();
});

test("a server that falls over is started again, but not for ever", async () => {
    program(SERVER.replace("server.js", "server.js --crash"));
    const editor = new Editor(folder);
    await editor.open();
    assert.match((await editor.told()).text, /rc lsp` keeps failing: out of order$/);
    assert.equal(editor.logged.filter((each) => each.endsWith("rc lsp")).length, 4);
    await editor.close();
    assert.equal(editor.messages.length, 1);
});

test("nothing of a folder that is not trusted is run", async () => {
    program(SERVER);
    const editor = new Editor(folder);
    editor.trusted = false;
    await editor.open();
    await editor.told();
    assert.ok(!editor.logged.some((each) => each.includes(".venv")));
    await editor.close();
});
