// A server, and a browser that looks at its page.

import { execFileSync, spawn } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

export const root = join(dirname(fileURLToPath(import.meta.url)), "../../..");
export const pictures = join(root, "build/page");
const envgraph = process.env.ENVGRAPH ?? "envgraph";
const axe = createRequire(import.meta.url).resolve("axe-core");

const domains = join(pictures, "domains");
rmSync(domains, { recursive: true, force: true });
mkdirSync(domains, { recursive: true });

/** The servers that run; a test that fails does not stop its own. */
const servers = new Set();
export const stopServers = () => servers.forEach((server) => server.kill("SIGKILL"));

export const launch = () => chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"] });

/** Return a new folder without files. */
export function emptyFolder(name) {
  const folder = join(mkdtempSync(join(domains, "new-")), name);
  mkdirSync(folder);
  return folder;
}

/** Return a new folder with a copy of a bundled domain. */
export function copyOf(domain) {
  const folder = join(mkdtempSync(join(domains, "copy-")), domain);
  cpSync(join(root, "rules", domain), folder, { recursive: true });
  return folder;
}

/** Return a new folder with a domain of mazes, and a family that is found in seconds. */
export function newMazes() {
  const folder = join(domains, "mazes");
  execFileSync(envgraph, ["new", "mazes"], { cwd: domains });
  cpSync(join(root, "editors/page/tests/small.toml"), join(folder, "small.toml"));
  return folder;
}

/** Start `envgraph serve` with a folder or a bundled domain; return its address, with the token, and a function that stops it. */
export async function serve(folder) {
  const server = spawn(envgraph, ["serve", "--no-browser", folder], { cwd: domains });
  servers.add(server);
  let output = "";
  const address = await new Promise((resolve, reject) => {
    const read = (data) => {
      output += data;
      const found = /http:\/\/127\.0\.0\.1:\d+\/\S*/.exec(output);
      if (found) resolve(found[0]);
    };
    server.stdout.on("data", read);
    server.stderr.on("data", read);
    server.on("exit", (code) => reject(new Error(`envgraph serve ended with ${code}:\n${output}`)));
  });
  const stop = () => new Promise((resolve) => {
    if (server.exitCode !== null) return resolve(server.exitCode);
    server.removeAllListeners("exit");
    server.on("exit", resolve);
    server.kill("SIGINT");
  });
  return { address, stop };
}

/** Open the page in a new tab; everything that goes wrong in it is collected in `problems`. */
export async function open(browser, address, { scheme = "light", width = 1280, height = 800 } = {}) {
  const context = await browser.newContext({ colorScheme: scheme, viewport: { width, height } });
  const tab = await context.newPage();
  tab.problems = [];
  tab.on("pageerror", (error) => tab.problems.push(error.message));
  tab.on("console", (message) => message.type() === "error" && tab.problems.push(message.text()));
  tab.on("request", (request) => {
    if (!/^(data|blob):/.test(request.url()) && !request.url().startsWith(new URL(address).origin)) tab.problems.push(`loads ${request.url()}`);
  });
  await tab.goto(address);
  await tab.locator(".cm-content").waitFor();
  return tab;
}

/** Choose a view by the buttons at the top. */
export const choose = (tab, view) => tab.locator(`nav [data-view="${view}"]`).click();

/** Return the serious findings of axe, and how much the page is wider than the window. */
export async function findings(tab) {
  // The policy of the page allows scripts of its own only, so the text of axe is evaluated by the debugger.
  await tab.evaluate(readFileSync(axe, "utf-8"));
  const { violations } = await tab.evaluate(() => axe.run());
  const serious = violations.filter(({ impact }) => ["serious", "critical"].includes(impact));
  const lines = serious.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  const wider = await tab.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  return wider > 0 ? [...lines, `${wider} px wider than the window`] : lines;
}
