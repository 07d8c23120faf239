// As much of VS Code as the extension needs: what it asks for is remembered, whatever else there is does nothing.

import { EventEmitter, once } from "node:events";
import Module from "node:module";
import { join } from "node:path";
import { EXTENSION } from "./textmate";

interface Extension {
    activate(context: { subscriptions: unknown[] }): Promise<void>;
    deactivate(): Promise<void>;
}

/** Anything: may be called, made, asked for a part of it, and gone through. */
function anything(): unknown {
    const target = class {
        dispose(): void {}
    };
    return new Proxy(target, {
        get: (_target, name) =>
            name === "then" ? undefined : name === Symbol.iterator ? [][Symbol.iterator].bind([]) : anything(),
        apply: () => anything(),
        construct: () => ({ dispose: () => {} }),
    });
}

/** A real class for everything that is extended, and `anything` for the rest. */
function partly(known: Record<string, unknown>): unknown {
    return new Proxy(known, {
        get: (target, name) =>
            name in target ? target[name as string] : /^[A-Z]/.test(String(name)) ? class {} : anything(),
        has: () => true,
    });
}

export class Editor {
    readonly messages: { text: string; buttons: string[] }[] = [];
    readonly typed: string[] = [];
    readonly logged: string[] = [];
    readonly commands = new Map<string, () => Promise<void>>();
    trusted = true;
    /** The button that a user presses. */
    press: string | undefined;
    private readonly happened = new EventEmitter();
    private extension: Extension | undefined;

    constructor(
        private readonly folder: string,
        private readonly settings: Record<string, unknown> = {},
    ) {}

    /** Load what `main` of package.json names, and activate it. */
    async open(): Promise<void> {
        const main = join(EXTENSION, "dist", "extension.js");
        const api = this.api();
        const loader = Module as unknown as { _load: (name: string, ...rest: unknown[]) => unknown };
        const load = loader._load;
        loader._load = (name, ...rest) => (name === "vscode" ? api : load(name, ...rest));
        try {
            delete require.cache[main];
            this.extension = require(main) as Extension;
        } finally {
            loader._load = load;
        }
        await this.extension.activate({ subscriptions: [] });
    }

    async close(): Promise<void> {
        await this.extension?.deactivate();
    }

    /** Wait until a message is shown. */
    async told(): Promise<{ text: string; buttons: string[] }> {
        while (this.messages.length === 0) {
            await once(this.happened, "change");
        }
        return this.messages[0]!;
    }

    /** Wait until the log has a line that says so. */
    async sees(pattern: RegExp): Promise<string> {
        for (;;) {
            const found = this.logged.find((each) => pattern.test(each));
            if (found !== undefined) {
                return found;
            }
            await once(this.happened, "change");
        }
    }

    private note<T>(list: T[], what: T): void {
        list.push(what);
        this.happened.emit("change");
    }

    private api(): unknown {
        const nothing = { dispose: () => {} };
        const uri = { scheme: "file", fsPath: this.folder, toString: () => `file://${this.folder}` };
        return partly({
            version: "1.82.0",
            CancellationError: Error,
            Uri: { parse: (text: string) => ({ toString: () => text }), file: () => uri },
            EventEmitter: class {
                private readonly heard = new EventEmitter();
                event = (hear: (what: unknown) => void) => (this.heard.on("fire", hear), nothing);
                fire(what: unknown): void {
                    this.heard.emit("fire", what);
                }
                dispose(): void {
                    this.heard.removeAllListeners();
                }
            },
            env: partly({ appName: "test", language: "en" }),
            commands: partly({
                registerCommand: (name: string, run: () => Promise<void>) => (this.commands.set(name, run), nothing),
            }),
            window: partly({
                tabGroups: { all: [], onDidChangeTabs: () => nothing, onDidChangeTabGroups: () => nothing },
                visibleTextEditors: [],
                activeTextEditor: undefined,
                createOutputChannel: () => ({
                    append: (text: string) => this.note(this.logged, text),
                    appendLine: (text: string) => this.note(this.logged, text),
                    show: () => this.note(this.logged, "shown"),
                    dispose: () => {},
                }),
                createTerminal: () => ({
                    show: () => {},
                    sendText: (text: string, enter: boolean) => this.note(this.typed, enter ? `${text}\n` : text),
                }),
                showErrorMessage: (text: string, ...buttons: string[]) => {
                    this.note(this.messages, { text, buttons });
                    return Promise.resolve(this.press);
                },
            }),
            workspace: partly({
                isTrusted: this.trusted,
                workspaceFolders: [{ uri, name: "test", index: 0 }],
                textDocuments: [],
                notebookDocuments: [],
                onDidGrantWorkspaceTrust: () => nothing,
                getConfiguration: () => ({
                    get: (name: string, otherwise: unknown) => this.settings[name] ?? otherwise,
                }),
            }),
        });
    }
}
