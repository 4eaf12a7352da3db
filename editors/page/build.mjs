// Builds the page into envgraph/page/built: a bundle, the texts that are copied, Graphviz in a file of its own.

import { build } from "esbuild";
import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const root = join(here, "../..");
const built = join(root, "envgraph/page/built");

/** Return the keywords of a grammar, and of the grammars that it imports. */
function keywordsOf(name) {
  const text = readFileSync(join(root, "grammars", `${name}.lark`), "utf-8").replace(/\/\/.*/g, "");
  const imported = [...text.matchAll(/%import\s+\.?(\w+)/g)].map((found) => found[1]).filter((other) => existsSync(join(root, "grammars", `${other}.lark`)));
  const own = [...text.matchAll(/"([a-z][A-Za-z_]*)"/g)].map((found) => found[1]);
  return [...new Set([...own, ...imported.filter((other) => other !== name).flatMap(keywordsOf)])].sort();
}

const LANGUAGES = ["metamodel", "query", "rules", "model", "environment"];
const keywords = Object.fromEntries(LANGUAGES.map((name) => [name, keywordsOf(name)]));

const NO_FILE = {
  "@viz-js/viz": `Copyright (c) Michael Daines, MIT License: https://github.com/mdaines/viz-js/blob/v3/LICENSE
It contains Graphviz (Eclipse Public License, source: https://gitlab.com/graphviz/graphviz) and Expat (MIT License, source:
https://github.com/libexpat/libexpat).`,
};

/** Return the licenses of the packages that are in the bundle; each asks to be part of every copy. */
function licenses(inputs) {
  const found = inputs.map((path) => /^(.*node_modules\/((@[^/]+\/)?[^/]+))\//.exec(path)).filter(Boolean);
  const folders = new Map(found.map(([, folder, name]) => [name, folder]));
  return [...folders].sort().map(([name, folder]) => {
    const file = readdirSync(folder).find((each) => /^licen[cs]e/i.test(each));
    const about = JSON.parse(readFileSync(join(folder, "package.json"), "utf-8"));
    const text = file ? readFileSync(join(folder, file), "utf-8").trim() : NO_FILE[name];
    if (!text) throw new Error(`${folder} has no license file: add the text of its license to NO_FILE`);
    return `${name} ${about.version}, ${about.license}\n\n${text}\n`;
  }).join("\n---\n\n");
}

rmSync(built, { recursive: true, force: true });
mkdirSync(built, { recursive: true });
const { metafile } = await build({
  entryPoints: [join(here, "src/main.js"), join(here, "src/page.css")],
  outdir: built,
  bundle: true,
  splitting: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "none",
  metafile: true,
  define: { GRAMMAR_KEYWORDS: JSON.stringify(keywords) },
  logLevel: "warning",
});
for (const name of ["index.html", "icon.svg"]) copyFileSync(join(here, "src", name), join(built, name));
writeFileSync(join(built, "licenses.txt"), licenses(Object.keys(metafile.inputs)));
