// The extension: it starts the language server and adds the commands.

import * as vscode from "vscode";
import { Server } from "./client";
import { Preview } from "./preview";
import { runTask, TASKS } from "./tasks";

const FAMILY_FILE = /^model\s*=\s*["'][^"']*\.(model|json|xmi)["']/m;

let server: Server | undefined;

/** Start the language server; VS Code calls this when a file of envgraph is opened first. */
export async function activate(context: vscode.ExtensionContext): Promise<void> {
    const output = vscode.window.createOutputChannel("envgraph", { log: true });
    const answers = vscode.window.createOutputChannel("envgraph: why not");
    const running = (server = new Server(output));
    const preview = new Preview(running);
    context.subscriptions.push(
        output,
        answers,
        preview,
        vscode.commands.registerCommand("envgraph.showPicture", () => preview.show()),
        vscode.commands.registerCommand("envgraph.whyNot", (name?: string, uri?: string) => whyNot(running, answers, name, uri)),
        vscode.commands.registerCommand("envgraph.check", () => runTask("check")),
        vscode.commands.registerCommand("envgraph.play", () => runTask("serve")),
        vscode.commands.registerCommand("envgraph.restart", () => running.restart()),
        vscode.tasks.registerTaskProvider("envgraph", TASKS),
        vscode.workspace.onDidOpenTextDocument(recogniseFamily),
        vscode.workspace.onDidChangeConfiguration((event) => event.affectsConfiguration("envgraph.command") && running.restart()),
    );
    vscode.workspace.textDocuments.forEach(recogniseFamily);
    await running.restart();
}

/** Stop the language server. */
export async function deactivate(): Promise<void> {
    await server?.stop();
}

/** Give family files their language: only their text tells them from other files of TOML. */
async function recogniseFamily(document: vscode.TextDocument): Promise<void> {
    if (["toml", "plaintext"].includes(document.languageId) && /\.toml$/.test(document.uri.path) && FAMILY_FILE.test(document.getText())) {
        await vscode.languages.setTextDocumentLanguage(document, "envgraph-toml");
    }
}

/** Show why a pattern, rule or unit of a file has no match; without a name, explain the name at the cursor. */
async function whyNot(server: Server, answers: vscode.OutputChannel, name?: string, uri?: string): Promise<void> {
    const editor = vscode.window.activeTextEditor;
    const range = editor?.document.getWordRangeAtPosition(editor.selection.active);
    const params = { name: name ?? (range && editor?.document.getText(range)), uri: uri ?? editor?.document.uri.toString() };
    if (!params.name) {
        await vscode.window.showInformationMessage("Place the cursor on the name of a pattern, a rule or a unit.");
        return;
    }
    answers.clear();
    try {
        answers.append((await server.request<{ text: string }>("envgraph/whyNot", params)).text);
    } catch (error) {
        answers.append(error instanceof Error ? error.message : String(error));
    }
    answers.show(true);
}
