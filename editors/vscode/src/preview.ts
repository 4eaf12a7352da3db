// The command "Show the Picture": a panel beside the text that is drawn again as the text changes.

import { randomBytes } from "node:crypto";
import * as vscode from "vscode";
import { LANGUAGES, type Server } from "./client";
import { previewPage, type Shown } from "./preview_page";

const PAUSE = 200; // milliseconds without a change before the picture is drawn again

/** The panel with the picture of the text that was edited last; at most one is open. */
export class Preview implements vscode.Disposable {
    private panel: vscode.WebviewPanel | undefined;
    private document: vscode.TextDocument | undefined;
    private position: vscode.Position | undefined;
    private timer: NodeJS.Timeout | undefined;
    private requests = 0;
    private readonly listeners: vscode.Disposable[];

    constructor(private readonly server: Server) {
        this.listeners = [
            vscode.workspace.onDidChangeTextDocument(({ document }) => this.panel && isOurs(document) && this.drawSoon()),
            vscode.window.onDidChangeActiveTextEditor((editor) => this.panel && this.follow(editor)),
        ];
    }

    /** Open the panel for the text in the active editor. */
    async show(): Promise<void> {
        this.panel ??= this.openPanel();
        this.panel.reveal(vscode.ViewColumn.Beside, true);
        this.follow(vscode.window.activeTextEditor);
    }

    dispose(): void {
        clearTimeout(this.timer);
        this.panel?.dispose();
        this.listeners.forEach((one) => one.dispose());
    }

    private openPanel(): vscode.WebviewPanel {
        const options = { enableScripts: true, localResourceRoots: [], retainContextWhenHidden: true };
        const beside = { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true };
        const panel = vscode.window.createWebviewPanel("envgraph.picture", "Picture", beside, options);
        panel.onDidDispose(() => (this.panel = undefined));
        panel.webview.html = previewPage(randomBytes(16).toString("hex"));
        return panel;
    }

    private follow(editor: vscode.TextEditor | undefined): void {
        if (editor && isOurs(editor.document)) {
            this.document = editor.document;
            this.position = editor.selection.active;
            this.drawSoon();
        }
    }

    private drawSoon(): void {
        clearTimeout(this.timer);
        this.timer = setTimeout(() => this.draw(), PAUSE);
    }

    /** Ask for the picture and show it, unless a later request was sent in the meantime. */
    private async draw(): Promise<void> {
        if (!this.document) {
            return;
        }
        const request = ++this.requests;
        const shown = await this.picture(this.document.uri);
        if (request === this.requests && this.panel) {
            this.panel.title = shown.title ?? this.panel.title;
            await this.panel.webview.postMessage(shown);
        }
    }

    private async picture(uri: vscode.Uri): Promise<Shown> {
        try {
            const params = { uri: uri.toString(), position: this.position };
            return (await this.server.request<Shown | null>("envgraph/preview", params)) ?? { message: "There is no model to draw." };
        } catch (error) {
            return { message: error instanceof Error ? error.message : String(error) };
        }
    }
}

function isOurs(document: vscode.TextDocument): boolean {
    return LANGUAGES.includes(document.languageId);
}
