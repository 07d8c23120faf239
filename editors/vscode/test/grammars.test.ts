// The grammars against fixtures that say what they expect, against the parsers' own grammars, and against real files.

import assert from "node:assert/strict";
import { readFileSync, readdirSync } from "node:fs";
import { basename, extname, join, relative } from "node:path";
import { test } from "node:test";
import { EXTENSION, LANGUAGES, PROJECT, grammar, manifest, tokens, within, type Token } from "./textmate";

const FIXTURES = join(EXTENSION, "test", "fixtures");
const KEYWORD = ["keyword", "storage", "support", "constant.language"];
const SHIPPED = ["components", "examples", "robocomp_py/interfaces", "tests/codegen/models"];

/** The words of a text that are what is called a keyword, in one way or another. */
function keywords(found: Token[]): Set<string> {
    const meant = found.filter((each) => KEYWORD.some((kind) => within(leaf(each), kind)));
    return new Set(meant.map((each) => each.text));
}

function leaf(token: Token): string {
    return token.scopes.at(-1) ?? "";
}

/** What has no name of its own: neither white space nor anything that a rule is there for. */
function unnamed(found: Token[]): Token[] {
    return found.filter((each) => each.text.trim() !== "" && /^(source|meta|markup)\./.test(leaf(each)));
}

function at(token: Token): string {
    return `line ${token.line + 1}: \`${token.text}\` is ${token.scopes.join(" ")}`;
}

function files(folder: string): string[] {
    return readdirSync(folder, { withFileTypes: true }).flatMap((each) => {
        const path = join(folder, each.name);
        return each.isDirectory() ? files(path) : [path];
    });
}

const language = (path: string): string => extname(path).slice(1);
const isOurs = (path: string): boolean => (LANGUAGES as readonly string[]).includes(language(path));

// Fixtures. A comment under a line says what stands above its marks: `// ^^^^ keyword.other` or, for the
// first column, `// <- keyword.other`. Several scopes must all be there; `!invalid` must not.

interface Expectation {
    line: number;
    from: number;
    to: number;
    scopes: string[];
}

function expectations(text: string): Expectation[] {
    const found: Expectation[] = [];
    let subject = 0;
    for (const [number, line] of text.split("\n").entries()) {
        const said = /^(\s*\/\/\s*)(<-|\^+)\s+(\S.*)$/.exec(line);
        if (!said) {
            subject = number;
            continue;
        }
        const [, lead = "", marks = "", scopes = ""] = said;
        const from = marks === "<-" ? lead.indexOf("//") : lead.length;
        found.push({ line: subject, from, to: marks === "<-" ? from + 1 : from + marks.length, scopes: scopes.split(/\s+/) });
    }
    return found;
}

function failure(wanted: Expectation, found: Token[]): string[] {
    const touched = found.filter(
        (each) => each.line === wanted.line && each.column < wanted.to && each.column + each.text.length > wanted.from,
    );
    if (touched.length === 0) {
        return [`line ${wanted.line + 1}: nothing stands at column ${wanted.from + 1}`];
    }
    return touched.flatMap((token) =>
        wanted.scopes
            .filter((scope) =>
                scope.startsWith("!")
                    ? token.scopes.some((each) => within(each, scope.slice(1)))
                    : !token.scopes.some((each) => within(each, scope)),
            )
            .map((scope) => `${at(token)}, not ${scope}`),
    );
}

for (const path of files(FIXTURES).filter(isOurs)) {
    test(`${basename(path)} is scoped as it says`, async () => {
        const text = readFileSync(path, "utf8");
        const wanted = expectations(text);
        const found = await tokens(`source.${language(path)}`, text);
        assert.ok(wanted.length > 0, "it says nothing");
        assert.deepEqual(wanted.flatMap((each) => failure(each, found)), []);
    });
}

// The parsers.

for (const name of LANGUAGES) {
    const path = join(PROJECT, "robocomp_py", "dsl", name, "grammar.lark");
    test(`every keyword of ${name}'s parser stands in a fixture as a keyword`, async () => {
        const lark = readFileSync(path, "utf8").replace(/\/\/.*$/gm, "").replace(/\/(?:[^/\n\\]|\\.)+\//g, "");
        const literals = [...lark.matchAll(/"([A-Za-z]\w*)"/g)].flatMap((each) => each[1] ?? []);
        const fixtures = files(FIXTURES).filter((each) => language(each) === name);
        const found = await Promise.all(fixtures.map((each) => tokens(`source.${name}`, readFileSync(each, "utf8"))));
        const shown = keywords(found.flat());
        assert.ok(literals.length > 5, `few keywords were found in ${path}`);
        assert.deepEqual(literals.filter((each) => !shown.has(each)), []);
    });
}

// Real files.

const shipped = SHIPPED.flatMap((folder) => files(join(PROJECT, folder))).filter(isOurs);

test("there are files of at least four languages to try", () => {
    assert.ok(new Set(shipped.map(language)).size >= 4);
});

for (const path of shipped) {
    test(`${relative(PROJECT, path)} has nothing invalid, and nothing without a name`, async () => {
        const found = await tokens(`source.${language(path)}`, readFileSync(path, "utf8"));
        const invalid = found.filter((each) => each.scopes.some((scope) => within(scope, "invalid")));
        assert.deepEqual([...invalid, ...unnamed(found)].map(at), []);
    });
}

for (const path of files(join(PROJECT, "docs", "reference", "languages")).filter((each) => each.endsWith(".md"))) {
    test(`the examples of ${relative(PROJECT, path)} have nothing invalid, and nothing without a name`, async () => {
        const found = await tokens("markdown.robocomp.fences", readFileSync(path, "utf8"));
        const inside = found.filter((each) => each.scopes.some((scope) => within(scope, "meta.embedded.block")));
        const invalid = inside.filter((each) => each.scopes.some((scope) => within(scope, "invalid")));
        assert.ok(inside.length > 0, "there is no example");
        assert.deepEqual([...invalid, ...unnamed(inside)].map(at), []);
    });
}

// Robustness.

for (const name of LANGUAGES) {
    test(`the grammar of ${name} has no rule that is not used, and names its file's scope`, async () => {
        const path = join(EXTENSION, "syntaxes", `${name}.tmLanguage.json`);
        const raw = JSON.parse(readFileSync(path, "utf8")) as { scopeName: string; repository: Record<string, unknown> };
        const everything = files(join(EXTENSION, "syntaxes")).map((each) => readFileSync(each, "utf8")).join();
        const unused = Object.keys(raw.repository).filter(
            (rule) => !everything.includes(`"#${rule}"`) && !everything.includes(`"source.${name}#${rule}"`),
        );
        assert.deepEqual(unused, []);
        assert.equal(raw.scopeName, `source.${name}`);
        assert.ok(await grammar(raw.scopeName));
    });
}

test("a Windows file is read like any other", async () => {
    const found = await tokens("source.idsl", "module A\r\n{\r\n    struct B { int x; };\r\n};\r\n");
    assert.deepEqual(unnamed(found), []);
});

test("a fence in Markdown is coloured, and ends where it ends, even if a block in it does not", async () => {
    const text = "```cdsl\nComponent c { language python;\n```\nrequires nothing\n";
    const found = await tokens("markdown.robocomp.fences", text);
    assert.ok(keywords(found).has("language"));
    const behind = found.filter((each) => each.line === 3);
    assert.deepEqual(behind.map((each) => each.scopes), [["markdown.robocomp.fences"]]);
});

test("every language has a grammar, snippets, an ending and icons", () => {
    const { languages, grammars, snippets } = manifest.contributes;
    assert.deepEqual(languages.map((each) => each.id), [...LANGUAGES]);
    for (const each of languages) {
        assert.deepEqual(each.extensions, [`.${each.id}`]);
        const own = [
            grammars.find((grammar) => grammar.language === each.id)?.path,
            snippets.find((snippet) => snippet.language === each.id)?.path,
            each.configuration,
            each.icon.light,
            each.icon.dark,
        ];
        own.forEach((path) => assert.ok(path && readFileSync(join(EXTENSION, path), "utf8"), `${each.id}: ${path}`));
    }
});
