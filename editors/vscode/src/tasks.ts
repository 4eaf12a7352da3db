// Tasks that run envgraph in a terminal: `envgraph check` and `envgraph serve`.

import { basename, dirname } from "node:path";
import * as vscode from "vscode";
import { findCommand, INSTALL } from "./command";

const SUBCOMMANDS = ["check", "serve"] as const;

interface Definition extends vscode.TaskDefinition {
    command: (typeof SUBCOMMANDS)[number];
    folder: string;
}

/** Offers the tasks `check` and `serve` for each folder of the window. */
export const TASKS: vscode.TaskProvider = {
    async provideTasks() {
        const folders = vscode.workspace.workspaceFolders ?? [];
        const found = folders.flatMap(({ uri }) => SUBCOMMANDS.map((command) => taskOf(command, uri.fsPath)));
        return (await Promise.all(found)).filter((task) => task !== undefined);
    },
    resolveTask: ({ definition }) => taskOf(definition.command, definition.folder, definition as Definition),
};

/** Run a command of envgraph on the folder of the active text; what `check` finds is listed in the view "Problems". */
export async function runTask(command: Definition["command"]): Promise<void> {
    const document = vscode.window.activeTextEditor?.document;
    if (document?.uri.scheme !== "file") {
        await vscode.window.showInformationMessage("Open a saved file of envgraph first.");
        return;
    }
    const task = await taskOf(command, dirname(document.uri.fsPath));
    if (task) {
        await vscode.tasks.executeTask(task);
    } else {
        await vscode.window.showErrorMessage(`envgraph was not found. Install it with \`${INSTALL}\`.`);
    }
}

/** Return a task; undefined if envgraph is not found. */
async function taskOf(
    command: Definition["command"],
    folder: string,
    definition: Definition = { type: "envgraph", command, folder },
): Promise<vscode.Task | undefined> {
    const found = await findCommand();
    if (!found) {
        return undefined;
    }
    const [program, ...rest] = found;
    // Names of files in the output are relative to the folder of the window, in which the problem matcher looks for them.
    const scope = vscode.workspace.getWorkspaceFolder(vscode.Uri.file(folder));
    const run = new vscode.ProcessExecution(program, [...rest, command, folder], { cwd: scope?.uri.fsPath ?? folder });
    const matchers = command === "check" ? ["$envgraph"] : [];
    const name = `${command} ${basename(folder)}`;
    const task = new vscode.Task(definition, scope ?? vscode.TaskScope.Workspace, name, "envgraph", run, matchers);
    task.isBackground = command === "serve"; // until it is stopped
    return task;
}
