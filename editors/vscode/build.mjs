// Bundles the extension to dist/extension.js, with the licences of what is in it beside it; with --tests, the
// tests to out/, each into a file of its own.

import { copyFileSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const common = { bundle: true, platform: "node", target: "node18", format: "cjs", logLevel: "warning" };

const { metafile } = await build({
    ...common,
    entryPoints: ["src/extension.ts"],
    outfile: "dist/extension.js",
    external: ["vscode"],
    minify: true,
    metafile: true,
});
writeFileSync("dist/licenses.txt", licences(Object.keys(metafile.inputs)));
copyFileSync("../../LICENSE", "LICENSE");

if (process.argv.includes("--tests")) {
    await build({
        ...common,
        entryPoints: readdirSync("test").filter((each) => each.endsWith(".test.ts")).map((each) => `test/${each}`),
        outdir: "out",
        packages: "external",
        sourcemap: "inline",
    });
}

/** The licence of every package that one of these files is from. */
function licences(files) {
    const packages = new Set(files.flatMap((each) => /^.*node_modules\/(?:@[^/]+\/)?[^/]+/.exec(each) ?? []));
    const texts = [...packages].sort().map((folder) => {
        const file = readdirSync(folder).find((each) => /^licen[cs]e/i.test(each));
        if (!file) {
            throw new Error(`${folder} has no licence to pass on`);
        }
        return `${folder.replace(/^.*node_modules\//, "")}\n\n${readFileSync(`${folder}/${file}`, "utf8").trim()}\n`;
    });
    return texts.join(`\n${"-".repeat(80)}\n\n`);
}
