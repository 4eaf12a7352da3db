// The page with texts that look like markup, files that change on the disk, and work that never ends, in Chromium.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { copyOf, emptyFolder, launch, open, serve, stopServers } from "./browser.mjs";

const MARKUP = `<img src=x onerror="alert(1)"><script>alert(2)</script>]]>&amp;'\u202e`;
const TEXTS = {
  "h.metamodel": `metamodel h\n\n/** ${MARKUP} <form action="https://a.example"><style>* { color: red }</style> */\nclass N { string s int v contains N[*] ns }\n`,
  "h.query": `package h\n\nimport "h.metamodel"\n\npattern named(n : N, s : string) { N.s(n, s); }\n`,
  "h.model": `import "h.metamodel"\n\nmodel m : h {\n    a : N { s = ${JSON.stringify(MARKUP)}, v = 0 }\n}\n`,
};
const NEVER = `\npattern never(a : N, b : N, c : N, d : N, e : N) { N.v(a, v); N.v(b, w); N.v(c, x); N.v(d, y); N.v(e, z); check v + w + x + y + z == 1; }\n`;

/** Return a new folder with texts, by file name. */
function folderOf(name, texts) {
  const folder = emptyFolder(name);
  for (const [file, text] of Object.entries(texts)) writeFileSync(join(folder, file), text);
  return folder;
}

let browser;
before(async () => { browser = await launch(); });
after(async () => {
  await browser?.close();
  stopServers();
});

async function openFolder(folder) {
  const server = await serve(folder);
  const tab = await open(browser, server.address);
  tab.on("dialog", (dialog) => (tab.problems.push(`dialog ${dialog.message()}`), dialog.dismiss()));
  return tab;
}

async function close(tab) {
  assert.deepEqual(tab.problems, []);
  await tab.context().close();
}

test("texts that look like markup are shown as texts", async () => {
  const name = "<img src=x onerror=alert(3)>.query";
  const tab = await openFolder(folderOf("<b onclick=alert(4)>b", { ...TEXTS, [name]: 'package i\nimport "h.metamodel"\n' }));
  await tab.locator(".picture svg").waitFor();
  assert.ok(await tab.locator(".files button", { hasText: name }).isVisible());
  await tab.locator('.names [data-key="pattern h.named"]').click();
  await tab.locator(".detail", { hasText: "<script>alert(2)</script>]]>&amp;'" }).waitFor();
  await tab.locator(".files button", { hasText: "h.model" }).click();
  await tab.locator(".cm-line span", { hasText: /^N$/ }).first().hover();
  await tab.locator(".cm-tooltip", { hasText: 'alert(1)' }).waitFor();
  assert.equal(await tab.locator("main img, main form, main script, main style, .cm-tooltip img, .cm-tooltip form, .cm-tooltip style").count(), 0);
  assert.equal(await tab.locator("h1 b").count(), 0);
  await close(tab);
});

test("a file that another program has changed is not replaced without a question", async () => {
  const folder = copyOf("sokoban");
  const path = join(folder, "sokoban.rules");
  const tab = await openFolder(folder);
  const edit = async (text) => {
    await tab.locator(".cm-content").focus();
    await tab.keyboard.press("Control+End");
    await tab.keyboard.insertText(text);
    await tab.keyboard.press("Control+s");
  };
  writeFileSync(path, "// theirs\r\n");
  await edit("// mine");
  await tab.locator(".alert", { hasText: "Another program has changed sokoban.rules" }).waitFor();
  assert.equal(readFileSync(path, "utf-8"), "// theirs\r\n");
  await tab.locator(".alert button", { hasText: "Take the other text" }).click();
  await tab.waitForFunction(() => document.querySelector(".cm-content")?.textContent === "// theirs" && !document.querySelector(".unsaved"));
  writeFileSync(path, "// theirs again\r\n");
  await edit("// mine");
  await tab.locator(".alert button", { hasText: "Save this text" }).click();
  await tab.waitForFunction(() => !document.querySelector(".unsaved") && !document.querySelector(".alert")?.textContent);
  assert.equal(readFileSync(path, "utf-8"), "// theirs\r\n// mine");
  await close(tab);
});

test("a search for matches that would never end is stopped by a button", async () => {
  const many = `a : N { v = 0, ns = [${Array(300).fill("N { v = 0 }").join(", ")}] }`;
  const tab = await openFolder(folderOf("endless", { ...TEXTS, "h.query": TEXTS["h.query"] + NEVER, "h.model": `import "h.metamodel"\n\nmodel m : h { ${many} }\n` }));
  await tab.locator(".computing button", { hasText: "Stop" }).click();
  await tab.waitForFunction(() => document.querySelector('[data-key$=".never"] .count')?.textContent === "?");
  await tab.locator('.names [data-key="pattern h.named"]').click();
  await tab.locator(".detail", { hasText: "named" }).waitFor();
  assert.ok(await tab.locator(".computing").isHidden());
  await close(tab);
});

test("a link on another page opens the page", async () => {
  const { address } = await serve(copyOf("sokoban"));
  const other = createServer((_, response) => response.writeHead(200, { "Content-Type": "text/html" }).end(`<a href="${address}">x</a>`));
  await new Promise((resolve) => other.listen(0, "127.0.0.1", resolve));
  const tab = await (await browser.newContext()).newPage();
  await tab.goto(`http://localhost:${other.address().port}/`); // for browsers not the same site as 127.0.0.1
  await tab.locator("a").click();
  await tab.locator(".picture svg").waitFor({ timeout: 10_000 });
  assert.equal(new URL(tab.url()).search, "");
  await tab.context().close();
  other.close();
});
