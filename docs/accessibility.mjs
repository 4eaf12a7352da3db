// Checks pages of the built site with axe-core, in light and dark and in four widths, and writes screenshots.
//
//     node docs/accessibility.mjs SITE FOLDER [PAGE ...]
//
// FOLDER holds node_modules with axe-core and playwright-core; `make docs-accessibility` installs them. The search is
// tried as well, with the pages opened from disk. The exit code is 1 if axe finds anything serious or critical, if a page
// is wider than the window, if it loads anything from elsewhere, or if the search finds nothing.

import { mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [site, folder, ...chosen] = process.argv.slice(2);
const require = createRequire(pathToFileURL(resolve(folder, "package.json")));
const { chromium } = require("playwright-core");
const axe = require.resolve("axe-core");
const pages = chosen.length ? chosen : [
  "index.html", "tutorials/maze.html", "languages/query.html", "reference/api/envgraph.graph.html",
  "gallery/sokoban.html", "reference/grammar-query.html", "search.html",
];
const widths = [360, 768, 1280, 1920];
const address = (page) => pathToFileURL(resolve(site, page)).href;
const problems = [];

async function checkPage(context, page, scheme, width) {
  const tab = await context.newPage();
  const name = `${page} (${scheme}, ${width} px)`;
  tab.on("request", (request) => {
    if (!/^(file|data|blob):/.test(request.url())) problems.push(`${name} loads ${request.url()}`);
  });
  await tab.setViewportSize({ width, height: 900 });
  await tab.goto(address(page));
  await tab.addScriptTag({ path: axe });
  const { violations } = await tab.evaluate(() => axe.run());
  for (const { id, impact, help, nodes } of violations) {
    const line = `${name}: ${impact}: ${id}: ${help}: ${nodes.length} times, such as ${nodes[0].html.slice(0, 150)}`;
    if (["serious", "critical"].includes(impact)) problems.push(line);
    else console.log(line);
  }
  const wider = await tab.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  if (wider > 0) problems.push(`${name} is ${wider} px wider than the window`);
  const file = `${page.replaceAll("/", "-").replace(".html", "")}-${scheme}-${width}.png`;
  await tab.screenshot({ path: join(folder, "screenshots", file) });
  await tab.close();
}

async function checkSearch(context) {
  const tab = await context.newPage();
  await tab.goto(`${address("search.html")}?q=sokoban`);
  const results = tab.locator("ul.search li a");
  await results.first().waitFor({ timeout: 10000 }).catch(() => problems.push("a search for sokoban finds nothing"));
  console.log(`a search for sokoban finds ${await results.count()} pages, first: ${await results.first().innerText()}`);
  await tab.close();
}

mkdirSync(join(folder, "screenshots"), { recursive: true });
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox"],
});
for (const scheme of ["light", "dark"]) {
  const context = await browser.newContext({ colorScheme: scheme });
  for (const page of pages) for (const width of widths) await checkPage(context, page, scheme, width);
  if (scheme === "light") await checkSearch(context);
  await context.close();
}
await browser.close();
console.log(problems.length ? problems.join("\n") : `nothing serious on ${pages.length} pages`);
process.exit(problems.length ? 1 : 0);
