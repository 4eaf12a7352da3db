// The page with its server, in Chromium: what a person does, one view after the other. Prints the times that people wait.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { choose, copyOf, findings, launch, newMazes, open, pictures, serve, stopServers } from "./browser.mjs";

let browser, folder, server;
before(async () => {
  browser = await launch();
  folder = copyOf("sokoban");
  server = await serve(folder);
});
after(async () => {
  await browser?.close();
  stopServers();
});

const choosePattern = (tab, key) => tab.locator(`.names [data-key="${key}"]`).click();
const openFile = (tab, name) => tab.locator(".files button", { hasText: name }).click();
const svgOf = (tab) => tab.locator(".picture svg").innerHTML();

async function type(tab, text) {
  await tab.locator(".cm-content").focus();
  await tab.keyboard.press("Control+End");
  await tab.keyboard.insertText(text);
}

test("the page is painted at once, and then shows texts, picture and counts", async () => {
  const started = performance.now();
  const tab = await open(browser, server.address);
  await tab.locator(".picture svg").waitFor();
  const shown = performance.now() - started;
  const paint = await tab.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0].startTime);
  console.log(`first paint after ${paint.toFixed(0)} ms, picture after ${shown.toFixed(0)} ms`);
  assert.ok(paint < 1000, `first paint after ${paint} ms`);
  await tab.waitForFunction(() => document.querySelector('[data-key$=".box"] .count')?.textContent === "2");
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
});

test("a mistake in a rule is shown at its place, and is gone after its cure", async () => {
  const tab = await open(browser, server.address);
  await openFile(tab, "sokoban.rules");
  await tab.locator(".problems h3", { hasText: "No problems" }).waitFor();
  const started = performance.now();
  await type(tab, "\nrule broken {\n    lhs { spot : Flor; }\n    modify { retype spot : Wall; }\n}\n");
  const problem = tab.locator(".problems .error", { hasText: "Flor" });
  await problem.waitFor();
  console.log(`the problem is shown ${(performance.now() - started).toFixed(0)} ms after the key`);
  await tab.locator(".stale", { hasText: "errors" }).waitFor();
  assert.match(await problem.innerText(), /sokoban\.rules:\d+/);
  await problem.click();
  for (let letter = 0; letter < 4; letter += 1) await tab.keyboard.press("Delete");
  await tab.keyboard.insertText("Floor");
  await tab.locator(".problems h3", { hasText: "No problems" }).waitFor();
  await tab.locator('.names [data-key="rule sokoban.broken"]').waitFor();
  assert.equal(await tab.locator(".stale", { hasText: "errors" }).isVisible(), false);
  await tab.keyboard.press("Control+s");
  await tab.waitForFunction(() => !document.querySelector(".unsaved"));
  assert.match(readFileSync(join(folder, "sokoban.rules"), "utf-8"), /spot : Floor; }\n {4}modify { retype spot : Wall; }\n}\n$/);
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
});

test("a domain that is opened with a mistake shows its model after the cure", async () => {
  const keydoor = copyOf("keydoor");
  const query = join(keydoor, "keydoor.query");
  writeFileSync(query, readFileSync(query, "utf-8").replace("pattern", "patern"));
  const broken = await serve(keydoor);
  const tab = await open(browser, broken.address);
  await tab.locator(".stale", { hasText: "The model is shown when they have none" }).waitFor();
  await tab.locator(".problems .error", { hasText: "patern" }).click();
  for (let letter = 0; letter < 6; letter += 1) await tab.keyboard.press("Delete");
  await tab.keyboard.insertText("pattern");
  await tab.locator(".picture svg").waitFor();
  await tab.locator('.names [data-key="pattern keydoor.step"]').waitFor();
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
  await broken.stop();
});

test("the keyboard alone reaches the content, and bundled files are not saved", async () => {
  const bundled = await serve("taxi");
  const tab = await open(browser, bundled.address);
  await tab.keyboard.press("Tab");
  assert.equal(await tab.evaluate(() => document.activeElement.className), "skip");
  await tab.keyboard.press("Enter");
  const reached = [];
  for (let press = 0; press < 60 && !reached.includes("cm-content"); press += 1) {
    await tab.keyboard.press("Tab");
    reached.push(await tab.evaluate(() => document.activeElement.className.split(" ")[0]));
  }
  await tab.keyboard.insertText("// mine\n");
  await tab.locator(".unsaved").waitFor();
  await tab.keyboard.press("Control+s");
  await tab.locator(".alert", { hasText: "read-only" }).waitFor();
  assert.match(await tab.locator(".alert", { hasText: "read-only" }).innerText(), /envgraph new \w+ --domain taxi/);
  await tab.keyboard.press("Escape"); // closes a list of words, if one is open
  await tab.keyboard.press("Escape");
  await tab.keyboard.press("Tab");
  assert.notEqual(await tab.evaluate(() => document.activeElement.className.split(" ")[0]), "cm-content");
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
  await bundled.stop();
});

test("completion, hover and rename answer in the editor", async () => {
  const tab = await open(browser, server.address);
  await openFile(tab, "sokoban.query");
  await type(tab, "\npattern here(spot : Flo");
  await tab.keyboard.press("Control+Space");
  await tab.locator(".cm-tooltip-autocomplete li", { hasText: "Floor" }).first().waitFor();
  await tab.waitForTimeout(150); // CodeMirror ignores keys in the first moments of a list
  await tab.keyboard.press("Tab");
  await tab.keyboard.type(") {");
  await tab.keyboard.press("Enter");
  await tab.keyboard.type("x");
  await tab.locator(".cm-line", { hasText: "pattern here(spot : Floor) {" }).waitFor();
  assert.match(await tab.locator(".cm-content").innerText(), /pattern here\(spot : Floor\) \{\n {4}x\n\}/);
  await tab.keyboard.press("Escape");
  for (let count = 0; count < 9; count += 1) await tab.keyboard.press("Control+z");
  await tab.keyboard.press("Control+Home");
  await tab.locator(".cm-content").getByText("Cell", { exact: true }).first().hover();
  await tab.locator(".cm-lsp-hover-tooltip").waitFor();
  await tab.locator(".cm-line", { hasText: "pattern step" }).click({ position: { x: 90, y: 10 } });
  await tab.keyboard.press("F2");
  await tab.locator(".cm-lsp-rename-panel input").fill("advance");
  await tab.keyboard.press("Enter");
  await tab.locator(".cm-line", { hasText: "pattern advance" }).waitFor();
  await tab.locator(".files button", { hasText: "sokoban.rules" }).locator(".unsaved").waitFor();
  await tab.locator('.names [data-key="pattern sokoban.advance"]').waitFor();
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
});

test("the matches of a pattern are marked one by one, and the absence of one is explained", async () => {
  const tab = await open(browser, server.address);
  await choosePattern(tab, "pattern sokoban.box");
  await tab.locator(".where", { hasText: "1 of 2 matches" }).waitFor();
  const first = await tab.locator(".marks .above").first().evaluate((mark) => mark.getAttribute("transform") + mark.getAttribute("x") + mark.getAttribute("y"));
  await tab.getByRole("button", { name: "Next match" }).click();
  const second = await tab.locator(".marks .above").first().evaluate((mark) => mark.getAttribute("transform") + mark.getAttribute("x") + mark.getAttribute("y"));
  assert.notEqual(first, second);
  await choosePattern(tab, "pattern sokoban.stuck");
  await tab.locator(".why").waitFor();
  await tab.locator(".places button").first().click();
  assert.equal(await tab.locator(".files [aria-pressed=true]").innerText(), "sokoban.query");
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
});

test("a rule is applied at the chosen match, undone and applied again", async () => {
  const tab = await open(browser, server.address);
  await choosePattern(tab, "rule sokoban.build");
  const before = await svgOf(tab);
  await tab.locator(".matches button").first().click();
  await tab.locator(".changes", { hasText: /./ }).waitFor();
  await tab.mouse.move(0, 0);
  const after = await svgOf(tab);
  assert.notEqual(after, before);
  await tab.getByRole("button", { name: "Undo" }).click();
  await tab.waitForFunction((text) => document.querySelector(".picture svg")?.innerHTML === text, before.replace(/<g class="marks">.*<\/g>/s, ""));
  await tab.getByRole("button", { name: "Redo" }).click();
  await tab.locator(".steps li").first().waitFor({ state: "attached" });
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
});

test("sokoban is played to its end by keys", async () => {
  const tab = await open(browser, server.address);
  await choose(tab, "play");
  await tab.locator(".eg-best", { hasText: "Solvable in" }).waitFor();
  const keys = [];
  while (!(await tab.locator(".eg-outcome").isVisible())) {
    await tab.getByRole("button", { name: "Step" }).click();
    await tab.waitForFunction((steps) => document.querySelector(".eg-figures dd")?.textContent === `${steps} of 120`, keys.length + 1);
    keys.push(await tab.locator(".eg-chosen kbd").innerText());
  }
  await tab.getByRole("button", { name: "Restart" }).click();
  await tab.locator(".eg-figures dd", { hasText: /^0 of 120$/ }).first().waitFor();
  await tab.locator(".eg-stage").focus();
  const names = { "←": "ArrowLeft", "→": "ArrowRight", "↑": "ArrowUp", "↓": "ArrowDown" };
  for (const [number, key] of keys.entries()) {
    await tab.keyboard.press(names[key]);
    await tab.waitForFunction((steps) => document.querySelector(".eg-figures dd")?.textContent === `${steps} of 120`, number + 1);
  }
  assert.match(await tab.locator(".eg-outcome").innerText(), /success/);
  await tab.keyboard.press("u");
  await tab.locator(".eg-outcome").waitFor({ state: "hidden" });
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
});

test("the best policy plays lava until the end, with the values of its actions", async () => {
  const lava = await serve(copyOf("lava"));
  const tab = await open(browser, lava.address);
  await choose(tab, "play");
  await tab.getByRole("button", { name: "Run" }).click();
  await tab.locator(".eg-value", { hasText: /\d/ }).first().waitFor();
  await tab.locator(".eg-outcome").waitFor({ timeout: 60000 });
  await tab.screenshot({ path: join(pictures, "lava.png") });
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
  await lava.stop();
});

test("the level is that of the view Edit, until another is chosen", async () => {
  const forest = await serve("burning_forest");
  const tab = await open(browser, forest.address);
  const level = () => tab.getByLabel("Level").inputValue();
  await choose(tab, "play");
  assert.equal(await level(), "model target_8x8");
  await choose(tab, "edit");
  await tab.getByRole("combobox", { name: "Model" }).selectOption("running_4x4");
  await choose(tab, "play");
  assert.equal(await level(), "model running_4x4");
  await tab.getByLabel("Level").selectOption("model target_8x8");
  await choose(tab, "edit");
  await choose(tab, "play");
  assert.equal(await level(), "model target_8x8");
  await tab.context().close();
  await forest.stop();
});

test("a search makes a family, whose members can be played", async () => {
  const mazes = await serve(newMazes());
  const tab = await open(browser, mazes.address);
  await choose(tab, "search");
  await tab.getByLabel("Family").selectOption({ label: "small.toml" });
  await tab.getByRole("button", { name: "Start" }).click();
  await tab.getByRole("button", { name: "Show the family" }).waitFor({ timeout: 120000 });
  const check = async (view) => {
    for (const [scheme, width] of [["light", 1280], ["dark", 1280], ["light", 360]]) {
      await tab.emulateMedia({ colorScheme: scheme });
      await tab.setViewportSize({ width, height: 800 });
      await tab.screenshot({ path: join(pictures, `${view}-${scheme}-${width}.png`), fullPage: width === 360 });
      assert.deepEqual(await findings(tab), [], view);
    }
  };
  await check("found");
  await tab.getByRole("button", { name: "Show the family" }).click();
  await tab.locator(".card").nth(5).waitFor();
  await check("family");
  await tab.locator(".card button").first().click();
  await tab.locator(".eg-stage svg").waitFor();
  assert.match(await tab.getByLabel("Level").inputValue(), /^member /);
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
  await mazes.stop();
});

test("a model without a grid is placed by Graphviz, and its objects can be marked", async () => {
  const railway = await serve(copyOf("railway"));
  const tab = await open(browser, railway.address);
  await tab.locator(".picture svg g.node[data-object]").first().waitFor({ timeout: 20000 });
  await tab.locator(".names button").filter({ hasNot: tab.getByText("0", { exact: true }) }).first().click();
  await tab.locator(".matches button").first().waitFor();
  await tab.screenshot({ path: join(pictures, "railway.png") });
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
  await railway.stop();
});

for (const [scheme, width] of [["light", 1280], ["dark", 1280], ["light", 360], ["dark", 360]]) {
  test(`every view is accessible and fits (${scheme}, ${width} px)`, async () => {
    const tab = await open(browser, server.address, { scheme, width });
    const check = async (view) => {
      await tab.screenshot({ path: join(pictures, `${view}-${scheme}-${width}.png`) });
      assert.deepEqual(await findings(tab), [], view);
    };
    await tab.locator(".picture svg").waitFor({ state: "attached" });
    await check("edit");
    if (width < 900) await tab.getByRole("button", { name: "Patterns and rules" }).click();
    await choosePattern(tab, "pattern sokoban.box");
    await tab.locator(".marks").waitFor();
    await check("pattern");
    await choosePattern(tab, "rule sokoban.build");
    await tab.locator(".matches .verb").first().waitFor();
    await check("rule");
    await choose(tab, "play");
    await tab.locator(".eg-best", { hasText: "Solvable in" }).waitFor();
    await check("play");
    await choose(tab, "search");
    await check("search");
    await choose(tab, "family");
    await check("no-family");
    assert.deepEqual(tab.problems, []);
    await tab.context().close();
  });
}

test("the page says when the server has stopped", async () => {
  const tab = await open(browser, server.address);
  await server.stop();
  await tab.getByRole("button", { name: "Connect again" }).waitFor();
  await tab.context().close();
});
