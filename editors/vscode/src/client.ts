// Start the language server, `envgraph lsp`, and say what to do if it does not start.

import { type ChildProcess, spawn } from "node:child_process";
import { once } from "node:events";
import * as vscode from "vscode";
import { CloseAction, ErrorAction, type ErrorHandler, LanguageClient, type LanguageClientOptions } from "vscode-languageclient/node";
import { type Command, findCommand, firstFolder, INSTALL } from "./command";

const LONGEST_REASON = 400; // characters; the rest is in the output
const SUFFIXES = "{metamodel,ecore,model,xmi,query,vql,rules,environment,toml}";
export const LANGUAGES = ["metamodel", "model", "query", "rules", "environment", "toml"].map((one) => `envgraph-${one}`);

/** The language server of this window; at most one runs at a time. */
export class Server {
    private client: LanguageClient | undefined;

    constructor(private readonly output: vscode.LogOutputChannel) {}

    /** Stop the server if it runs, and start it again. Show a message if it cannot be started. */
    async restart(): Promise<void> {
        await this.stop();
        const command = await findCommand();
        if (!command) {
            void report(`envgraph was not found. Install it with \`${INSTALL}\`, or name it in the setting envgraph.command.`);
            return;
        }
        const errors: string[] = [];
        const onError: ErrorHandler = {
            error: (...values) => (this.client ? whenStarted.error(...values) : { action: ErrorAction.Shutdown, handled: true }),
            closed: () => (this.client ? whenStarted.closed() : { action: CloseAction.DoNotRestart, handled: true }),
        };
        const options = { ...this.options(), errorHandler: onError };
        const client = new LanguageClient("envgraph", "envgraph", () => start(command, errors), options);
        const whenStarted = client.createDefaultErrorHandler();
        try {
            await client.start();
            this.client = client;
        } catch (error) {
            const reason = errors.join("").trim().slice(-LONGEST_REASON) || String(error);
            void report(`The language server \`${command.join(" ")} lsp\` did not start: ${reason}`);
        }
    }

    /** Stop the server if it runs. */
    async stop(): Promise<void> {
        const client = this.client;
        this.client = undefined;
        await client?.dispose();
    }

    /**
     * Return the result of a request.
     *
     * @throws if the server does not run, or answers with an error.
     */
    async request<Result>(method: string, params: object): Promise<Result> {
        if (!this.client) {
            throw new Error("the language server does not run: use the command `envgraph: Restart the Language Server`");
        }
        return this.client.sendRequest<Result>(method, params);
    }

    private options(): LanguageClientOptions {
        return {
            documentSelector: LANGUAGES.map((language) => ({ language })),
            outputChannel: this.output,
            diagnosticCollectionName: "envgraph", // also the owner of what tasks find, so that nothing is listed twice
            synchronize: { fileEvents: vscode.workspace.createFileSystemWatcher(`**/*.${SUFFIXES}`) },
            initializationFailedHandler: () => false,
        };
    }
}

/**
 * Start the server and collect what it writes to standard error.
 *
 * @throws if there is no such program.
 */
async function start([program, ...rest]: Command, errors: string[]): Promise<ChildProcess> {
    const server = spawn(program, [...rest, "lsp"], { cwd: firstFolder()?.uri.fsPath });
    server.stderr.on("data", (data) => errors.push(String(data)));
    await once(server, "spawn");
    return server;
}

async function report(message: string): Promise<void> {
    const [copy, settings] = ["Copy the command for pip", "Open the setting"];
    const chosen = await vscode.window.showErrorMessage(message, copy, settings);
    if (chosen === copy) {
        await vscode.env.clipboard.writeText(INSTALL);
    } else if (chosen === settings) {
        await vscode.commands.executeCommand("workbench.action.openSettings", "envgraph.command");
    }
}
