// The grammars as an editor runs them: texts to words with their scopes.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { createOnigScanner, createOnigString, loadWASM } from "vscode-oniguruma";
import { INITIAL, Registry, parseRawGrammar, type IGrammar } from "vscode-textmate";

/** Where package.json is; the tests run bundled, from out/. */
export const EXTENSION = resolve(__dirname, "..");
export const PROJECT = resolve(EXTENSION, "..", "..");
export const LANGUAGES = ["idsl", "cdsl", "pdsl", "ddsl", "smdsl"] as const;

export interface Manifest {
    version: string;
    contributes: {
        languages: { id: string; extensions: string[]; configuration: string; icon: { light: string; dark: string } }[];
        grammars: { scopeName: string; path: string; language?: string }[];
        snippets: { language: string; path: string }[];
        configuration: { properties: Record<string, unknown> };
        commands: { command: string }[];
    };
}

export const manifest = JSON.parse(readFileSync(join(EXTENSION, "package.json"), "utf8")) as Manifest;

/** A piece of a line, with what the grammar calls it, outermost first. */
export interface Token {
    line: number;
    column: number;
    text: string;
    scopes: string[];
}

const wasm = readFileSync(
    join(dirname(createRequire(join(EXTENSION, "package.json")).resolve("vscode-oniguruma")), "onig.wasm"),
);

const registry = new Registry({
    onigLib: loadWASM(wasm).then(() => ({ createOnigScanner, createOnigString })),
    loadGrammar: (scope) => {
        const found = manifest.contributes.grammars.find((each) => each.scopeName === scope);
        if (!found) {
            throw new Error(`no grammar is called ${scope}`);
        }
        const path = join(EXTENSION, found.path);
        return Promise.resolve(parseRawGrammar(readFileSync(path, "utf8"), path));
    },
});

export async function grammar(scope: string): Promise<IGrammar> {
    const found = await registry.loadGrammar(scope);
    if (!found) {
        throw new Error(`no grammar is called ${scope}`);
    }
    return found;
}

/** A text's pieces; lines and columns begin at 0. */
export async function tokens(scope: string, text: string): Promise<Token[]> {
    const rules = await grammar(scope);
    const found: Token[] = [];
    let state = INITIAL;
    for (const [line, content] of text.split(/\r?\n/).entries()) {
        const result = rules.tokenizeLine(content, state);
        state = result.ruleStack;
        for (const each of result.tokens) {
            const end = Math.min(each.endIndex, content.length);
            if (each.startIndex < end) {
                const text = content.slice(each.startIndex, end);
                found.push({ line, column: each.startIndex, text, scopes: each.scopes });
            }
        }
    }
    return found;
}

/** Whether a scope is the wanted one, or a narrower one: `keyword.other` of `keyword.other.qos.cdsl`. */
export function within(scope: string, wanted: string): boolean {
    return scope === wanted || scope.startsWith(`${wanted}.`);
}
