// Commands that run envgraph in a terminal: `envgraph check` as a task, and `envgraph serve`.

import { dirname } from "node:path";
import * as vscode from "vscode";
import { findCommand } from "./command";

/** Run `envgraph check` on the folder of the active text; its mistakes are listed in the view "Problems". */
export async function check(): Promise<void> {
    const folder = activeFolder();
    const task = folder && (await checkTask({ type: "envgraph", folder }));
    if (task) {
        await vscode.tasks.executeTask(task);
    }
}

/** Start `envgraph serve` on the folder of the active text; it opens a page in the browser. */
export async function play(): Promise<void> {
    const [folder, command] = [activeFolder(), await findCommand()];
    if (folder && command) {
        const [shellPath, ...rest] = command;
        vscode.window.createTerminal({ name: "envgraph serve", shellPath, shellArgs: [...rest, "serve", folder], cwd: folder }).show();
    }
}

/** The tasks of the type `envgraph`: one for each folder of the window. */
export const TASKS: vscode.TaskProvider = {
    async provideTasks() {
        const folders = vscode.workspace.workspaceFolders ?? [];
        const tasks = folders.map(({ uri }) => checkTask({ type: "envgraph", folder: uri.fsPath }));
        return (await Promise.all(tasks)).filter((task) => task !== undefined);
    },
    resolveTask: (task) => checkTask(task.definition as CheckDefinition),
};

interface CheckDefinition extends vscode.TaskDefinition {
    folder: string;
}

/** Return a task that runs `envgraph check`; undefined if envgraph is not found. */
async function checkTask(definition: CheckDefinition): Promise<vscode.Task | undefined> {
    const command = await findCommand();
    if (!command) {
        return undefined;
    }
    const [program, ...rest] = command;
    const run = new vscode.ProcessExecution(program, [...rest, "check", definition.folder], { cwd: definition.folder });
    const name = `check ${vscode.workspace.asRelativePath(definition.folder)}`;
    const task = new vscode.Task(definition, vscode.TaskScope.Workspace, name, "envgraph", run, "$envgraph");
    task.group = vscode.TaskGroup.Build;
    return task;
}

function activeFolder(): string | undefined {
    const document = vscode.window.activeTextEditor?.document;
    return document?.uri.scheme === "file" ? dirname(document.uri.fsPath) : undefined;
}
