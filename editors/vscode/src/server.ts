// Where the language server is, and what to tell users when it is not there or does not start. Nothing of VS Code in here.

import { posix, win32 } from "node:path";

/** What the search depends on. */
export interface Surroundings {
    /** The workspace's folders; none of one that is not trusted: what is in it must not be run. */
    folders: readonly string[];
    /** The variable PATH. */
    path: string;
    home: string;
    windows: boolean;
    isProgram: (path: string) => boolean;
}

export interface Search {
    /** The first that is there. */
    program: string | undefined;
    /** Everything that would have done, in order. */
    candidates: string[];
}

/**
 * The program that a setting means. A bare name is looked for in the virtual environments of the folders, then
 * in PATH; a relative path begins at the folders.
 */
export function findServer(setting: string, around: Surroundings): Search {
    const own = around.windows ? win32 : posix;
    const name = setting.trim() || "rc";
    const candidates = [...new Set(places(name, around, own).flatMap((each) => spellings(each, around, own)))];
    return { program: candidates.find(around.isProgram), candidates };
}

function places(name: string, around: Surroundings, own: typeof posix): string[] {
    if (/^~[\\/]/.test(name)) {
        return [own.join(around.home, name.slice(2))];
    }
    if (own.isAbsolute(name)) {
        return [name];
    }
    if (/[\\/]/.test(name)) {
        return around.folders.map((folder) => own.join(folder, name));
    }
    const environments = around.folders.map((folder) => own.join(folder, ".venv", around.windows ? "Scripts" : "bin"));
    const listed = around.path.split(own.delimiter).filter((each) => own.isAbsolute(each));
    return [...environments, ...listed].map((folder) => own.join(folder, name));
}

function spellings(path: string, around: Surroundings, own: typeof posix): string[] {
    return around.windows && own.extname(path) === "" ? [`${path}.exe`] : [path];
}

/** What a user types to get the language server, into the environment of `program` if that is one. */
export function installCommand(program: string | undefined, around: Surroundings): string {
    const own = around.windows ? win32 : posix;
    const quote = around.windows ? '"' : "'";
    const wanted = `${quote}robocomp-py[lsp]${quote}`;
    const python = program && own.join(own.dirname(program), around.windows ? "python.exe" : "python");
    if (!python || !around.isProgram(python)) {
        return `pip install ${wanted}`;
    }
    const call = /^[\w./:\\-]+$/.test(python) ? python : `${quote}${python}${quote}`;
    return `${call} -m pip install ${wanted}`;
}

/** What to tell a user, and whether installing would help. */
export interface Advice {
    message: string;
    install: boolean;
}

export function missing(setting: string): Advice {
    const where = /[\\/]/.test(setting) ? "is not a program" : "is neither in a .venv of the workspace nor in PATH";
    return {
        message: `RoboComp: \`${setting}\` ${where}. It brings the language server: pip install 'robocomp-py[lsp]'`,
        install: true,
    };
}

/** Why a server ended that had not been asked to, from what it wrote to stderr. */
export function ended(program: string, stderr: string, wasReady: boolean): Advice {
    const lines = stderr.split(/\r?\n/).filter((each) => each.trim() !== "");
    if (lines.some((each) => each.includes("robocomp-py[lsp]"))) {
        return {
            message: `RoboComp: the language server of ${program} is not installed: pip install 'robocomp-py[lsp]'`,
            install: true,
        };
    }
    const last = lines.at(-1)?.trim();
    const what = wasReady ? "keeps failing" : "did not start";
    return { message: `RoboComp: \`${program} lsp\` ${what}${last ? `: ${last}` : ""}`, install: false };
}
