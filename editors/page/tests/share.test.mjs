import assert from "node:assert/strict";
import { test } from "node:test";
import { filesOfLink, linkWith } from "../src/share.js";

const files = [{ name: "a.metamodel", text: "metamodel a\n// ä → 漢\n" }, { name: "a.rules", text: "rule r { }\n".repeat(500) }];

test("a link holds the texts, and is shorter than they are", async () => {
  globalThis.location = { href: "http://x/play#old", hash: "#old" };
  const link = await linkWith(files);
  assert.match(link, /^http:\/\/x\/play#domain=[A-Za-z0-9_-]+$/);
  assert.ok(link.length < 500);
  globalThis.location = { href: link, hash: new URL(link).hash };
  assert.deepEqual(await filesOfLink(), files);
});

test("an address without texts opens no files", async () => {
  globalThis.location = { href: "http://x/#play", hash: "#play" };
  assert.equal(await filesOfLink(), null);
});

test("a link that was cut is refused", async () => {
  globalThis.location = { href: "http://x/", hash: "" };
  const { hash } = new URL(await linkWith(files));
  globalThis.location = { href: "http://x/", hash: hash.slice(0, -20) };
  await assert.rejects(filesOfLink(), /Perhaps the link was cut/);
});

test("a link whose files would fill the memory is refused", async () => {
  const { deflateRawSync } = await import("node:zlib");
  const packed = deflateRawSync(Buffer.alloc(200_000_000)).toString("base64url");
  globalThis.location = { href: "http://x/", hash: `#domain=${packed}` };
  await assert.rejects(filesOfLink(), /longer than 20 MB/);
});

test("a link without files is refused", async () => {
  const { deflateRawSync } = await import("node:zlib");
  for (const text of ["null", "[]", "{}", '{"files": 1}', '{"files": [null]}', "["]) {
    globalThis.location = { href: "http://x/", hash: `#domain=${deflateRawSync(text).toString("base64url")}` };
    await assert.rejects(filesOfLink(), /Perhaps the link was cut/);
  }
});
