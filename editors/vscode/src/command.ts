// Find the command that starts envgraph.

import { execFile } from "node:child_process";
import { promisify } from "node:util";
import * as vscode from "vscode";

const run = promisify(execFile);

export const INSTALL = 'pip install "envgraph[editor]"';

/** A program and its first arguments. */
export type Command = [string, ...string[]];

/** The part of the Python extension's interface that names the selected interpreter. */
interface PythonExtension {
    environments?: {
        getActiveEnvironmentPath(resource?: vscode.Uri): { path: string };
        resolveEnvironment(path: { path: string }): Promise<{ executable: { uri?: vscode.Uri } } | undefined>;
    };
}

/** Return the first folder of the window, in which envgraph is started; undefined without folders. */
export function firstFolder(): vscode.WorkspaceFolder | undefined {
    return vscode.workspace.workspaceFolders?.[0];
}

/** Return the command of the setting, of the selected Python interpreter, or of the PATH; undefined if there is none. */
export async function findCommand(): Promise<Command | undefined> {
    const [program, ...rest] = vscode.workspace.getConfiguration("envgraph", firstFolder()).get<string[]>("command", []);
    if (program) {
        return [program, ...rest];
    }
    const python = await selectedInterpreter();
    const candidates: Command[] = [["envgraph"]];
    if (python) {
        candidates.unshift([python, "-m", "envgraph"]);
    }
    for (const candidate of candidates) {
        if (await works(candidate)) {
            return candidate;
        }
    }
    return undefined;
}

/** Return the path of the interpreter that is selected in the Python extension; undefined without the extension. */
async function selectedInterpreter(): Promise<string | undefined> {
    const extension = vscode.extensions.getExtension<PythonExtension>("ms-python.python");
    if (!extension) {
        return undefined;
    }
    const { environments } = extension.isActive ? extension.exports : await extension.activate();
    const path = environments?.getActiveEnvironmentPath(firstFolder()?.uri);
    return path && (await environments?.resolveEnvironment(path))?.executable.uri?.fsPath;
}

async function works([program, ...rest]: Command): Promise<boolean> {
    try {
        await run(program, [...rest, "--version"], { cwd: firstFolder()?.uri.fsPath, timeout: 20_000 });
        return true;
    } catch {
        return false;
    }
}
