// Colours and snippets need no code. This starts the language server, `rc lsp`, and says so when it cannot.

import { spawn, type ChildProcess } from "node:child_process";
import { once } from "node:events";
import { accessSync, constants, statSync } from "node:fs";
import { homedir } from "node:os";
import { PassThrough } from "node:stream";
import * as vscode from "vscode";
import { CloseAction, ErrorAction, LanguageClient, State, type CloseHandlerResult, type StreamInfo } from "vscode-languageclient/node";
import { ended, findServer, installCommand, missing, type Advice, type Surroundings } from "./server";

const LANGUAGES = ["idsl", "cdsl", "pdsl", "ddsl", "smdsl"];
const XML = { scheme: "file", language: "xml" }; // the server answers only about InnerModel
const MOST_CRASHES = 3;
const CRASHES_WITHIN_MS = 3 * 60 * 1000;
const KEPT_OF_STDERR = 4000;
const PATIENCE_MS = 2000;

let session: Session | undefined;

export async function activate(context: vscode.ExtensionContext): Promise<void> {
    const log = vscode.window.createOutputChannel("RoboComp");
    const restart = async (): Promise<void> => {
        const before = session;
        const next = (session = new Session(log));
        await before?.stop();
        await next.start();
    };
    context.subscriptions.push(
        log,
        vscode.commands.registerCommand("robocomp.restartServer", restart),
        vscode.commands.registerCommand("robocomp.showLog", () => log.show()),
        vscode.workspace.onDidGrantWorkspaceTrust(restart),
        vscode.workspace.onDidChangeConfiguration((event) =>
            event.affectsConfiguration("robocomp.server.path") ? restart() : undefined,
        ),
    );
    await restart();
}

export async function deactivate(): Promise<void> {
    await session?.stop();
}

/** The client says nothing in windows of its own: what users must know, the session tells them, once. */
class Client extends LanguageClient {
    override error(message: string, data?: unknown): void {
        super.error(message, data, false);
    }

    /** Nothing if it is not running, which the client calls a mistake. */
    override async stop(timeout?: number): Promise<void> {
        if (this.isRunning()) {
            await super.stop(timeout);
        }
    }
}

/** One server, from its start until it is stopped or given up; a new one is a new session. */
class Session {
    private client: Client | undefined;
    private process: ChildProcess | undefined;
    private input = new PassThrough();
    private gone: Promise<void> = Promise.resolve();
    private stderr = "";
    private ready = false;
    private over = false;
    private crashes: number[] = [];

    constructor(private readonly log: vscode.OutputChannel) {}

    async start(): Promise<void> {
        if (this.over) {
            return;
        }
        const setting = settings().get<string>("server.path", "rc");
        const around = surroundings();
        const { program, candidates } = findServer(setting, around);
        if (!program) {
            this.log.appendLine(`no language server; looked for ${candidates.join(", ") || setting}`);
            this.over = true;
            void this.tell(missing(setting), undefined);
            return;
        }
        const client = (this.client = this.make(program));
        client.onDidChangeState(({ newState }) => {
            this.ready ||= newState === State.Running;
        });
        try {
            await client.start();
        } catch (error) {
            this.log.appendLine(String(error));
            await this.giveUp(program);
        }
    }

    async stop(): Promise<void> {
        const asked = this.client?.isRunning() ?? false;
        this.over = true;
        try {
            await this.client?.stop();
        } catch (error) {
            this.log.appendLine(`the language server did not stop: ${String(error)}`);
        }
        await this.end(asked ? PATIENCE_MS : 0);
    }

    private make(program: string): Client {
        return new Client("robocomp", "RoboComp", () => this.spawn(program), {
            documentSelector: [
                ...LANGUAGES.flatMap((language) => ["file", "untitled"].map((scheme) => ({ scheme, language }))),
                XML,
            ],
            outputChannel: this.log,
            traceOutputChannel: this.log,
            initializationOptions: () => ({ include: settings().get<string[]>("include", []) }),
            initializationFailedHandler: () => false, // `start` tells of it
            synchronize: { configurationSection: "robocomp" },
            errorHandler: {
                error: () => ({ action: ErrorAction.Continue }), // if it is serious, it also closes
                closed: () => this.closed(program),
            },
        });
    }

    /** What is written to a server that is gone gets lost here, quietly: that it is gone is told by its output's end. */
    private async spawn(program: string): Promise<StreamInfo> {
        const folder = vscode.workspace.workspaceFolders?.find((each) => each.uri.scheme === "file");
        this.log.appendLine(`${program} lsp`);
        const started = spawn(program, ["lsp"], folder ? { cwd: folder.uri.fsPath } : {});
        this.stderr = "";
        this.ready = false;
        started.stderr.on("data", (part: Buffer) => {
            this.log.append(part.toString("utf8"));
            this.stderr = (this.stderr + part.toString("utf8")).slice(-KEPT_OF_STDERR);
        });
        started.stdin.on("error", (error) => this.log.appendLine(`the language server: ${error.message}`));
        try {
            await once(started, "spawn");
        } catch (error) {
            this.stderr = String(error);
            await this.giveUp(program);
            throw error;
        }
        started.on("error", (error) => this.log.appendLine(`the language server: ${error.message}`));
        this.process = started;
        this.input = new PassThrough();
        this.gone = new Promise((resolve) => started.once("close", () => resolve()));
        if (this.over) {
            await this.end(0);
            throw new Error("stopped before it was started");
        }
        this.input.pipe(started.stdin);
        return { reader: started.stdout, writer: this.input, detached: true };
    }

    /** The server ended. One that was of use is started again, unless it falls over again and again. */
    private async closed(program: string): Promise<CloseHandlerResult> {
        const now = Date.now();
        this.crashes = [...this.crashes, now].filter((each) => now - each < CRASHES_WITHIN_MS);
        if (this.ready && !this.over && this.crashes.length <= MOST_CRASHES) {
            return { action: CloseAction.Restart, handled: true };
        }
        await this.giveUp(program);
        return { action: CloseAction.DoNotRestart, handled: true };
    }

    private async giveUp(program: string): Promise<void> {
        if (this.over) {
            return;
        }
        this.over = true;
        await this.end(PATIENCE_MS); // then all it wrote is here
        void this.tell(ended(program, this.stderr, this.ready), program);
    }

    /** Wait until the process is gone, with an end to patience. */
    private async end(patience: number): Promise<void> {
        this.input.end();
        let timer: NodeJS.Timeout | undefined;
        const enough = new Promise<void>((resolve) => (timer = setTimeout(resolve, patience)));
        await Promise.race([this.gone, enough]);
        clearTimeout(timer);
        this.process?.kill("SIGKILL");
    }

    private async tell(advice: Advice, program: string | undefined): Promise<void> {
        const [install, change, show] = ["Install…", "Change the setting", "Show the log"];
        const buttons = advice.install ? [install, change] : [show, change];
        const chosen = await vscode.window.showErrorMessage(advice.message, ...buttons);
        if (chosen === install) {
            const terminal = vscode.window.createTerminal("RoboComp");
            terminal.show();
            terminal.sendText(installCommand(program, surroundings()), false); // to be read, changed, and entered
        } else if (chosen === change) {
            await vscode.commands.executeCommand("workbench.action.openSettings", "robocomp.server.path");
        } else if (chosen === show) {
            this.log.show();
        }
    }
}

function settings(): vscode.WorkspaceConfiguration {
    return vscode.workspace.getConfiguration("robocomp");
}

function surroundings(): Surroundings {
    const folders = vscode.workspace.workspaceFolders ?? [];
    return {
        folders: vscode.workspace.isTrusted
            ? folders.filter((each) => each.uri.scheme === "file").map((each) => each.uri.fsPath)
            : [],
        path: process.env["PATH"] ?? "",
        home: homedir(),
        windows: process.platform === "win32",
        isProgram,
    };
}

function isProgram(path: string): boolean {
    try {
        accessSync(path, constants.X_OK);
        return statSync(path).isFile();
    } catch {
        return false;
    }
}
