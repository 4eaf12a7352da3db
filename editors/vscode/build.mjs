// Build the extension into `build/`: the grammars, the program, the icon, and the licence.

import { build } from "esbuild";
import { initWasm, Resvg } from "@resvg/resvg-wasm";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";

process.chdir(import.meta.dirname);
mkdirSync("build", { recursive: true });

execFileSync(process.env.PYTHON ?? "python3", ["grammars.py", "build/syntaxes"], { stdio: "inherit" });

const { metafile } = await build({
    entryPoints: ["src/extension.ts"],
    outfile: "build/extension.js",
    bundle: true,
    platform: "node",
    format: "cjs",
    target: "node20",
    external: ["vscode"], // provided by VS Code
    minify: true,
    legalComments: "none",
    metafile: true,
});

const packages = Object.keys(metafile.inputs).map((path) => path.match(/^(.*node_modules\/(?:@[^/]+\/)?[^/]+)\//)?.[1]);
const licences = [...new Set(packages)].filter(Boolean).sort().map((folder) => {
    const file = readdirSync(folder).find((name) => /^licen[cs]e/i.test(name));
    return `${folder.replace(/^.*node_modules\//, "")}\n\n${readFileSync(`${folder}/${file}`, "utf8")}`;
});
writeFileSync("build/LICENSES-OF-PACKAGES.txt", licences.join(`\n${"-".repeat(80)}\n\n`));

await initWasm(readFileSync(createRequire(import.meta.url).resolve("@resvg/resvg-wasm/index_bg.wasm")));
const icon = new Resvg(readFileSync("icons/extension.svg", "utf8"), { fitTo: { mode: "width", value: 256 } });
writeFileSync("build/icon.png", icon.render().asPng());

copyFileSync("../../LICENSE", "LICENSE");
