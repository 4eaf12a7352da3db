// Run `suite.cjs` in the extension host of a real VS Code: the server of the package `code-server`, in headless Chromium.
//
// The suite calls the interface of VS Code. For what only a person sees, it asks this program to look at the page.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { cpSync, existsSync, mkdirSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { dirname, join } from "node:path";
import { chromium } from "playwright-core";

const VERSION = "4.100.3"; // with VS Code 1.100, the last that runs on Node 20
const COMPILED = ["node-pty", "@vscode/spdlog"]; // for terminals and for outputs
const extension = join(import.meta.dirname, "..");
const folder = join(extension, "build", "vscode");
const server = join(folder, "node_modules", "code-server", "lib", "vscode");
const workspace = join(folder, "keydoor");

if (!COMPILED.every((name) => existsSync(join(server, "node_modules", name, "build", "Release")))) {
    mkdirSync(folder, { recursive: true });
    // Without the scripts, which download ripgrep.
    const install = ["install", "--no-save", "--no-audit", "--no-fund", "--ignore-scripts", "--omit=dev"];
    execFileSync("npm", [...install, "--prefix", folder, `code-server@${VERSION}`], { stdio: "inherit" });
    execFileSync("npm", [...install, "--prefix", server], { stdio: "inherit" });
    const node = dirname(dirname(process.execPath)); // its headers are used, so none are downloaded
    execFileSync("npm", ["rebuild", ...COMPILED, "--yes", "--prefix", server, `--nodedir=${node}`], { stdio: "inherit" });
}
rmSync(workspace, { recursive: true, force: true });
cpSync(join(extension, "..", "..", "rules", "keydoor"), workspace, { recursive: true });
// VS Code replaces the PATH by that of a login shell, so the command is set.
const settings = { "envgraph.command": [process.env.PYTHON ?? "python3", "-m", "envgraph"], "git.enabled": false };
mkdirSync(join(workspace, ".vscode"));
writeFileSync(join(workspace, ".vscode", "settings.json"), JSON.stringify(settings));

/** Start the server of VS Code, and return its process and its port. */
function startServer(environment) {
    const data = join(folder, "data");
    rmSync(data, { recursive: true, force: true });
    const options = ["--host=127.0.0.1", "--port=0", "--without-connection-token", "--accept-server-license-terms"];
    options.push(`--server-data-dir=${data}`, "--telemetry-level=off", "--disable-workspace-trust");
    const process = spawn("node", [join(server, "out", "server-main.js"), ...options], { env: environment });
    return new Promise((resolve) => {
        process.stdout.on("data", (text) => {
            const found = /listening on (\d+)/.exec(String(text));
            if (found) {
                resolve([process, found[1]]);
            }
        });
    });
}

/** Return the frames of webviews with a picture. */
async function pictures(page) {
    const found = [];
    for (const frame of page.frames()) {
        const image = frame.locator("img[src^='data:image/svg+xml']");
        if (await image.count().catch(() => 0)) {
            found.push({
                title: await frame.locator("h1").textContent(),
                message: await frame.locator("p").textContent(),
                size: await image.evaluate((one) => [one.naturalWidth, one.naturalHeight]),
                source: await image.getAttribute("src"),
            });
        }
    }
    return found;
}

/** What the suite may ask for, by name. */
const ANSWERS = {
    pictures,
    notifications: (page) => page.locator(".notification-toast .notification-list-item-message").allTextContents(),
    problems: (page) => page.locator(".markers-panel .monaco-list-row").allTextContents(),
    screenshot: (page, name) => page.screenshot({ path: join(folder, `${name}.png`) }).then(() => name),
    press: (page, key) => page.keyboard.press(key).then(() => key),
};

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"] });
const page = await browser.newPage({ viewport: { width: 1400, height: 900 } });
const eyes = createServer(async (request, response) => {
    const { pathname, searchParams } = new URL(request.url, "http://localhost");
    response.end(JSON.stringify(await ANSWERS[pathname.slice(1)](page, searchParams.get("argument"))));
}).listen(0, "127.0.0.1");
await once(eyes, "listening");

const [process_, port] = await startServer({ ...process.env, EYES: `http://127.0.0.1:${eyes.address().port}`, ELECTRON_RUN_AS_NODE: "" });
try {
    const exit = new Promise((resolve) => page.exposeFunction("codeAutomationExit", resolve));
    await page.exposeFunction("codeAutomationLog", (_, [text]) => /^(not )?ok: /.test(text) && console.log(text));
    const remote = (path) => `vscode-remote://127.0.0.1:${port}${path}`;
    const payload = [["extensionDevelopmentPath", remote(extension)], ["extensionTestsPath", remote(join(import.meta.dirname, "suite.cjs"))]];
    await page.goto(`http://127.0.0.1:${port}/?folder=${workspace}&payload=${encodeURIComponent(JSON.stringify(payload))}`);
    const late = new Promise((resolve) => setTimeout(resolve, 180_000, "no result after three minutes"));
    const code = await Promise.race([exit, late]);
    await page.screenshot({ path: join(folder, "end.png") });
    assert.equal(code, 0, "the suite failed; its messages are above");
} finally {
    await browser.close();
    process_.kill();
    eyes.close();
}
