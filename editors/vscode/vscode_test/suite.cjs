// Tests that run in the extension host of VS Code, with the real language server; `run.mjs` starts them.

const assert = require("node:assert/strict");
const { join } = require("node:path");
const vscode = require("vscode");

const folder = vscode.workspace.workspaceFolders[0].uri;
const at = (document, text) => document.positionAt(document.getText().indexOf(text) + 1);
const provider = (name, ...values) => vscode.commands.executeCommand(`vscode.execute${name}Provider`, ...values);

async function open(name) {
    const document = await vscode.workspace.openTextDocument(vscode.Uri.joinPath(folder, name));
    await vscode.window.showTextDocument(document, vscode.ViewColumn.One);
    return document;
}

/** Return what the page shows: pictures, notifications, a screenshot. */
async function look(name, argument = "") {
    return (await fetch(`${process.env.EYES}/${name}?argument=${argument}`)).json();
}

/** Return the first value of a function that is not empty, within ten seconds. */
async function eventually(what, value) {
    for (let tries = 0; tries < 100; tries++) {
        const found = await value();
        if (found && found.length !== 0) {
            return found;
        }
        await new Promise((resolve) => setTimeout(resolve, 100));
    }
    return assert.fail(`${what} did not happen within ten seconds`);
}

async function edit(document, before, after) {
    const change = new vscode.WorkspaceEdit();
    const start = document.getText().indexOf(before);
    assert.ok(start >= 0, before);
    change.replace(document.uri, new vscode.Range(document.positionAt(start), document.positionAt(start + before.length)), after);
    await vscode.workspace.applyEdit(change);
}

const TESTS = {
    async "files have their languages"() {
        for (const language of ["metamodel", "query", "rules", "environment"]) {
            assert.equal((await open(`keydoor.${language}`)).languageId, `envgraph-${language}`);
        }
        assert.equal((await open("two_rooms.model")).languageId, "envgraph-model");
        assert.equal((await open("family.toml")).languageId, "envgraph-toml");
        await open("diverse.toml");
        const language = () => vscode.workspace.textDocuments.find((one) => one.uri.path.endsWith("diverse.toml"))?.languageId;
        await eventually("recognising a family file", () => language() === "envgraph-toml");
    },

    async "mistakes are shown while typing, and vanish"() {
        const document = await open("keydoor.rules");
        await edit(document, "hero -at-> here : Cell", "hero -at-> here : Cel");
        const [mistake] = await eventually("a diagnostic", () => vscode.languages.getDiagnostics(document.uri));
        assert.match(mistake.message, /unknown type `Cel`/);
        assert.equal(document.getText(mistake.range), "Cel");
        await look("screenshot", "mistake");
        await edit(document, "hero -at-> here : Cel", "hero -at-> here : Cell");
        await eventually("the end of the mistake", () => vscode.languages.getDiagnostics(document.uri).length === 0);
    },

    async "names have hovers, definitions, references and new names"() {
        const document = await open("keydoor.rules");
        const name = at(document, "enterable(there)");
        const [hover] = await provider("Hover", document.uri, name);
        assert.match(hover.contents.map((one) => one.value).join(), /enterable/);
        const [definition] = await provider("Definition", document.uri, name);
        assert.match((definition.uri ?? definition.targetUri).path, /keydoor\.query$/);
        const references = await provider("Reference", document.uri, name);
        assert.ok(references.length >= 2);
        const renamed = await vscode.commands.executeCommand("vscode.executeDocumentRenameProvider", document.uri, name, "free");
        assert.deepEqual(renamed.entries().map(([uri]) => uri.path.split("/").at(-1)).sort(), ["keydoor.query", "keydoor.rules"]);
        const symbols = await provider("DocumentSymbol", document.uri);
        assert.ok(symbols.some((one) => one.name === "walk"));
    },

    async "a rule has a lens"() {
        const document = await open("keydoor.rules");
        const lenses = await eventually("a lens", () => provider("CodeLens", document.uri, 20));
        assert.match(lenses.map((one) => one.command?.title).join(), /\d/);
    },

    async "names are completed"() {
        const document = await open("keydoor.query");
        assert.ok(!document.getText().includes("Maze"), "VS Code itself completes words of the text");
        const { items } = await provider("CompletionItem", document.uri, at(document, "Exit(exit)"));
        assert.ok(items.some((one) => (one.label.label ?? one.label) === "Maze"));
    },

    async "the picture follows the text"() {
        const document = await open("two_rooms.model");
        await vscode.commands.executeCommand("envgraph.showPicture");
        const [before] = await eventually("a picture", () => look("pictures"));
        assert.ok(before.size[0] > 100 && before.size[1] > 50, String(before.size));
        assert.equal(before.message, "");
        await look("screenshot", "picture-light");
        await edit(document, "#.r#.X#", "#.r#XX#");
        await eventually("another picture", async () => (await look("pictures")).some((one) => one.source !== before.source));
        await edit(document, "#.r#XX#", "#.r#?X#");
        await eventually("a message above the last picture", async () => (await look("pictures")).some((one) => one.message));
        await look("screenshot", "picture-mistake");
        await edit(document, "#.r#?X#", "#.r#.X#");
        await eventually("the first picture", async () => (await look("pictures")).some((one) => one.source === before.source && !one.message));
        await vscode.workspace.getConfiguration("workbench").update("colorTheme", "Default Dark Modern", true);
        await new Promise((resolve) => setTimeout(resolve, 1000));
        await look("screenshot", "picture-dark");
    },

    async "why not explains a pattern"() {
        await open("keydoor.query");
        await vscode.commands.executeCommand("envgraph.whyNot", "keydoor.holds");
        const shown = () => vscode.workspace.textDocuments.find((one) => one.uri.scheme === "output" && /holds/.test(one.getText()));
        await eventually("an explanation", shown);
        await look("screenshot", "why-not");
    },

    async "a check is a task that lists mistakes of files that are not open"() {
        const broken = vscode.Uri.joinPath(folder, "broken.query");
        await vscode.workspace.fs.writeFile(broken, Buffer.from('import "keydoor.metamodel"\npattern p(x : Kee) { Key(x); }\n'));
        await open("keydoor.query");
        const ended = new Promise((resolve) => vscode.tasks.onDidEndTaskProcess((event) => resolve(event.exitCode)));
        await vscode.commands.executeCommand("envgraph.check");
        assert.equal(await ended, 1);
        await vscode.commands.executeCommand("workbench.actions.view.problems");
        // What the task finds and what the language server finds replace each other: the mistake is listed once.
        const [mistake, ...others] = await eventually("a problem", async () => (await look("problems")).slice(1));
        assert.match(mistake, /^unknown type `Kee`.*\[Ln 2, Col 15\]$/s);
        assert.deepEqual(others, []);
        await look("screenshot", "problems");
        await vscode.workspace.fs.delete(broken);
    },

    async "the tasks of a folder check it and serve its page"() {
        const tasks = await vscode.tasks.fetchTasks({ type: "envgraph" });
        assert.deepEqual(tasks.map((one) => one.execution.args.slice(-2)), [["check", folder.fsPath], ["serve", folder.fsPath]]);
    },

    async "doc comments and brackets are continued while typing"() {
        const document = await vscode.workspace.openTextDocument({ language: "envgraph-query" });
        await vscode.window.showTextDocument(document);
        for (const text of ["/", "*", "*", " ", "W", "\n", "x"]) {
            await vscode.commands.executeCommand("type", { text });
        }
        assert.equal(document.getText(), "/** W\n * x\n */");
        await edit(document, document.getText(), "");
        for (const text of ["{", "\n", "x"]) {
            await vscode.commands.executeCommand("type", { text });
        }
        assert.equal(document.getText(), "{\n    x\n}");
        await vscode.commands.executeCommand("workbench.action.revertAndCloseActiveEditor");
    },

    async "a command that does not start is reported with what to do"() {
        const settings = vscode.workspace.getConfiguration("envgraph");
        const works = settings.get("command");
        const use = (command) => settings.update("command", command, vscode.ConfigurationTarget.Workspace);
        const message = (text) => async () => (await look("notifications")).some((one) => text.test(one));
        await use([process.execPath, "-e", "throw Error('no server here')"]);
        await eventually("a message", message(/did not start: .*no server here/s));
        await look("screenshot", "not-started");
        await use([join(folder.fsPath, "nothing")]);
        await eventually("a message", message(/nothing.*ENOENT/));
        await use(works);
        const document = await open("keydoor.query");
        const symbols = () => provider("DocumentSymbol", document.uri);
        await eventually("symbols after another start", symbols);
    },
};

exports.run = async () => {
    const failed = [];
    for (const [name, test] of Object.entries(TESTS)) {
        try {
            await test();
            console.log(`ok: ${name}`);
        } catch (error) {
            failed.push(name);
            console.log(`not ok: ${name}\n${error.stack}`);
        }
    }
    if (failed.length) {
        throw new Error(`failed: ${failed.join("; ")}`);
    }
};
