// Writes the playground, a page without a server: node editors/playground/build.mjs FOLDER
// The folder has the texts that pack.py writes. The page is built before, by `make page`.

import { appendFileSync, cpSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { gzipSync } from "node:zlib";

process.on("uncaughtException", (error) => { // Node would print the line of Pyodide's source, which has 600,000 letters
  console.error(error.message);
  process.exit(1);
});
const here = dirname(fileURLToPath(import.meta.url));
const page = join(here, "../../envgraph/page/built");
const folder = resolve(process.argv[2]);

/** Copy files into a folder of the playground. */
const copy = (from, names, to) => names.forEach((name) => cpSync(join(from, name), join(folder, to, name)));
const assets = readdirSync(page).filter((name) => !["index.html", "licenses.txt"].includes(name));
copy(page, assets, "");
appendFileSync(join(folder, "licenses.txt"), readFileSync(join(page, "licenses.txt")));
copy(here, ["start.css", "worker.mjs", "python.mjs", "start.py"], "");
const meta = `<meta charset="utf-8">
  <meta http-equiv="Content-Security-Policy" content="default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; script-src 'self' 'wasm-unsafe-eval'; base-uri 'none'; form-action 'none'">
  <meta name="envgraph-worker" content="worker.mjs">`;
const shell = readFileSync(join(page, "index.html"), "utf-8");
writeFileSync(join(folder, "page.html"), shell.replace('<meta charset="utf-8">', meta));
copy(join(here, "node_modules/pyodide"), ["pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip"], "pyodide");

// The packages that Pyodide could load from its site, which the playground never asks.
const lock = JSON.parse(readFileSync(join(here, "node_modules/pyodide/pyodide-lock.json"), "utf-8"));
writeFileSync(join(folder, "pyodide/pyodide-lock.json"), JSON.stringify({ ...lock, packages: {} }));

const { inflate, startNewPython } = await import(pathToFileURL(join(folder, "python.mjs")));
const load = (path) => inflate(new Uint8Array(readFileSync(join(folder, path))));
const python = await startNewPython(load, { _makeSnapshot: true });
python.runPython(readFileSync(join(here, "warm_up.py"), "utf-8"));
python.globals.get("warm_up")("maze", readFileSync(join(folder, "domains/maze.json"), "utf-8"));
const memory = python.makeMemorySnapshot();
writeFileSync(join(folder, "memory.bin"), gzipSync(memory, { level: 9 }));
