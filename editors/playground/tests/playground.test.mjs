// The playground in Chromium, from a static server, below a path. Prints the times that people wait.

import assert from "node:assert/strict";
import { createReadStream, existsSync } from "node:fs";
import { createServer } from "node:http";
import { dirname, extname, join, normalize } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

const folder = join(dirname(fileURLToPath(import.meta.url)), "../../../build/playground");
const TYPES = { ".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".mjs": "text/javascript", ".svg": "image/svg+xml", ".wasm": "application/wasm", ".json": "application/json" };
const PATH = "/somewhere/below/";
let browser, server, address;

before(async () => {
  server = createServer((request, response) => {
    const { pathname } = new URL(request.url, "http://localhost");
    const file = join(folder, normalize(pathname.slice(PATH.length) || "index.html"));
    if (!pathname.startsWith(PATH) || !file.startsWith(folder) || !existsSync(file)) return response.writeHead(404).end();
    response.writeHead(200, { "Content-Type": TYPES[extname(file)] ?? "application/octet-stream" });
    createReadStream(file).pipe(response);
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  address = `http://127.0.0.1:${server.address().port}${PATH}`;
  browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"] });
});
after(async () => {
  await browser?.close();
  server?.close();
});

/** Open a tab; what goes wrong in it is collected in `problems`. */
async function newTab() {
  const tab = await (await browser.newContext()).newPage();
  tab.problems = [];
  tab.on("pageerror", (error) => tab.problems.push(error.message));
  tab.on("console", (message) => message.type() === "error" && tab.problems.push(message.text()));
  tab.on("request", (request) => {
    if (!/^(data|blob):/.test(request.url()) && !request.url().startsWith(address)) tab.problems.push(`loads ${request.url()}`);
  });
  return tab;
}

async function open(query) {
  const tab = await newTab();
  await tab.goto(address + query);
  await tab.locator(".picture svg").waitFor();
  return tab;
}

async function close(tab) {
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
}

test("a click on a domain shows its picture; the time is printed", async () => {
  const times = [];
  for (let time = 0; time < 3; time += 1) {
    const tab = await newTab();
    await tab.goto(address);
    await tab.waitForLoadState("networkidle");
    const started = performance.now();
    await tab.getByText("Maze").click();
    await tab.locator(".picture svg").waitFor();
    times.push(performance.now() - started);
    await close(tab);
  }
  console.log(`the picture is shown ${times.map((time) => time.toFixed(0)).join(", ")} ms after the click`);
});

test("each domain opens without problems", async () => {
  const tab = await newTab();
  await tab.goto(address);
  const links = await tab.locator("li a").evaluateAll((all) => all.map((one) => one.getAttribute("href")));
  await close(tab);
  assert.equal(links.length, 13);
  for (const link of links) {
    const page = await open(link);
    await page.locator(".problems h3", { hasText: "No problems" }).waitFor();
    await close(page);
  }
});

test("an edited domain is shared by a link, without a server", async () => {
  const tab = await open("page.html?domain=sokoban");
  await tab.locator(".files button", { hasText: "sokoban.query" }).click();
  await tab.locator(".cm-content").focus();
  await tab.keyboard.press("Control+End");
  await tab.keyboard.insertText("\npattern playground(spot : Flor) { Cell.west(spot, _); }\n");
  await tab.locator(".problems .error", { hasText: "Flor" }).click();
  for (let letter = 0; letter < 4; letter += 1) await tab.keyboard.press("Delete");
  await tab.keyboard.insertText("Floor");
  await tab.locator('[data-key$="sokoban.playground"]').waitFor();
  await tab.getByRole("button", { name: "Share" }).click();
  await tab.waitForFunction(() => location.hash.startsWith("#domain="));
  const link = tab.url();
  await close(tab);
  const other = await open(link.slice(address.length));
  await other.locator('[data-key$="sokoban.playground"]').waitFor();
  await close(other);
});

test("a level is played by keys, and what needs a server says so", async () => {
  const tab = await open("page.html?domain=sokoban");
  await tab.locator('nav [data-view="play"]').click();
  await tab.locator(".eg-stage svg").waitFor();
  const before = await tab.locator(".eg-stage svg").innerHTML();
  await tab.locator(".eg-stage").focus();
  for (const key of ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"]) await tab.keyboard.press(key);
  await tab.waitForFunction((old) => document.querySelector(".eg-stage svg").innerHTML !== old, before);
  await tab.getByText("need NumPy").waitFor();
  await close(tab);
});

test("the page opens without the stored memory, too", async () => {
  const tab = await newTab();
  await tab.route("**/memory.bin", (route) => route.abort());
  await tab.goto(`${address}page.html?domain=maze`);
  await tab.locator(".picture svg").waitFor({ timeout: 120_000 });
  await tab.context().close(); // the failed request is a problem, as expected
});
