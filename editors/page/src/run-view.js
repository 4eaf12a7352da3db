// The views "Family" and "Search": the members of a run, and a search that makes new ones.

import { describeBest, formatNumber, make, messageOf, showSvg } from "../../../envgraph/page/player.js";

/** @typedef {import("./types.js").Member} Member */

/** Return a card with the picture of a member. @param {Member} member @param {((name: string) => void)|null} play */
function memberCard(member, play) {
  const picture = make("div", { class: "thumb" });
  showSvg(picture, member.svg, `Map of ${member.title ?? member.name}`);
  return make("article", { class: "card" }, picture, make("h4", {}, member.title ?? member.name),
    make("p", { "data-certificate": member.name }, describeBest(member.certificate)),
    ...(play ? [make("button", { type: "button", onclick: () => play(member.name) }, "Play", make("span", { class: "hidden" }, ` ${member.name}`))] : []));
}

/** @param {[string, string][]} rows */
const figures = (rows) => make("dl", { class: "figures" }, ...rows.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));

/** @param {any} value */
const written = (value) => (typeof value === "number" ? formatNumber(value) : String(value ?? "–"));

export class FamilyView {
  /** @param {import("./domain.js").Domain} domain @param {(name: string) => void} play */
  constructor(domain, play) {
    this.domain = domain;
    this.play = play;
    this.runs = make("select", { onchange: () => this.open(this.runs.value) });
    this.content = make("div", {});
    this.choice = make("label", { class: "choices", hidden: true }, "Run", this.runs);
    this.element = make("div", { class: "family" }, this.choice, this.content);
  }

  async show() {
    try {
      const { connection } = this.domain;
      const { runs: all, open } = await connection.request("page/run/list");
      const runs = all.filter((/** @type {any} */ run) => run.members || run.problem); // searches that ended early have no members
      this.choice.hidden = !runs.length;
      this.runs.replaceChildren(...runs.map((/** @type {any} */ { name, family }) =>
        make("option", { value: name, selected: name === (this.opened ?? open) }, family && family !== name ? `${name} (${family})` : name)));
      if (runs.length) await this.open(this.runs.value);
      else this.content.replaceChildren(make("p", { class: "quiet" }, "There is no run yet. Start one under Search, or with `envgraph generate`."));
    } catch (error) {
      this.content.replaceChildren(make("p", { class: "alert", role: "alert" }, messageOf(error)));
    }
  }

  /** @param {string} name */
  async open(name) {
    this.opened = name;
    this.content.replaceChildren(make("p", { class: "quiet", role: "status" }, "Opening the run …"));
    try {
      const run = await this.domain.connection.request("page/run/open", { name });
      this.domain.data = await this.domain.connection.request("page/open"); // its members can be played now
      this.showRun(run);
    } catch (error) {
      this.content.replaceChildren(make("p", { class: "alert", role: "alert" }, messageOf(error)));
    }
  }

  /** @param {any} run */
  showRun(run) {
    const parts = [make("p", {}, `${run.summary}.`)];
    const titled = (/** @type {Member} */ member) => (member.name === run.target?.name ? { ...member, title: `${member.title ?? member.name}, the target` } : member);
    parts.push(make("h3", {}, `${run.measures[0].value} members`),
      make("div", { class: "cards" }, ...run.members.map((/** @type {Member} */ member) => memberCard(titled(member), this.play))));
    if (run.lineage?.length) {
      parts.push(make("h3", {}, "Lineage"), ...run.lineage.map((/** @type {any} */ each) => make("details", {},
        make("summary", {}, `${each.name}: ${each.steps.length} rule application${each.steps.length === 1 ? "" : "s"}`), make("ol", {}, ...each.steps.map((/** @type {string} */ step) => make("li", {}, step))))));
    }
    for (const table of run.training ?? []) parts.push(make("h3", {}, table.title), makeTable(table));
    this.content.replaceChildren(...parts);
    this.certify(run.members);
  }

  /** Compute the certificates that the run does not hold, one after the other, while they are on the page. @param {Member[]} members */
  async certify(members) {
    for (const { name } of members) {
      const texts = [...this.content.querySelectorAll(`[data-certificate="${CSS.escape(name)}"]`)];
      if (!texts.length || texts[0].textContent) continue;
      for (const text of texts) text.textContent = "…";
      const line = await this.domain.connection.request("page/certificate", { member: name }).then(describeBest, messageOf);
      for (const text of texts) text.textContent = line;
      if (!texts[0].isConnected) return;
    }
  }
}

/** @param {{title: string, header: string[], rows: any[][]}} table */
const makeTable = ({ title, header, rows }) => make("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": title }, make("table", {},
  make("thead", {}, make("tr", {}, ...header.map((cell) => make("th", { scope: "col" }, cell)))),
  make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((cell) => make("td", {}, written(cell))))))));

export class SearchView {
  /** @param {import("./domain.js").Domain} domain @param {(run: string) => void} openRun */
  constructor(domain, openRun) {
    this.domain = domain;
    this.openRun = openRun;
    this.family = make("select", {});
    this.seed = make("input", { type: "number", value: "1", min: "0", step: "1" });
    this.generations = make("input", { type: "number", class: "wide", min: "1", step: "1", placeholder: "as in the file" });
    this.button = make("button", { type: "submit", class: "primary" }, "Start");
    this.message = make("p", { class: "alert", role: "alert" });
    this.progress = make("div", {});
    this.element = make("div", { class: "search" },
      make("form", { class: "choices", onsubmit: (/** @type {Event} */ event) => (event.preventDefault(), this.toggle()) },
        make("label", {}, "Family", this.family), make("label", {}, "Seed", this.seed), make("label", {}, "Generations", this.generations), this.button),
      this.message, this.progress);
    this.isRunning = false;
    /** @type {any} */ this.latest = {};
    domain.connection.on("page/search/progress", (progress) => this.showProgress(progress));
  }

  show() {
    const families = this.domain.data.files.filter((file) => file.name.endsWith(".toml"));
    const chosen = this.family.value || families.find((file) => file.name.endsWith("family.toml"))?.uri;
    this.family.replaceChildren(...families.map((file) => make("option", { value: file.uri, selected: file.uri === chosen }, file.name)));
    this.button.disabled = !families.length;
    if (!families.length) this.message.textContent = "This domain has no family file (.toml), so that there is nothing to search for.";
  }

  /** @param {boolean} isRunning */
  setRunning(isRunning) {
    this.isRunning = isRunning;
    this.button.textContent = isRunning ? "Stop" : "Start";
    this.button.classList.toggle("primary", !isRunning);
  }

  async toggle() {
    const { connection } = this.domain;
    this.message.textContent = "";
    try {
      if (this.isRunning) return void (await connection.request("page/search/stop"));
      this.setRunning(true);
      this.latest = {};
      this.progress.replaceChildren(make("p", { class: "quiet", role: "status" }, "The search begins …"));
      await connection.request("page/search/start", {
        family: this.family.value, seed: Number(this.seed.value),
        ...(this.generations.value ? { generations: Number(this.generations.value) } : {}), // families with an objective have none
      });
    } catch (error) {
      this.setRunning(false);
      this.progress.replaceChildren();
      this.message.textContent = messageOf(error);
    }
  }

  /** @param {any} news */
  showProgress(news) {
    const progress = (this.latest = { ...this.latest, ...news }); // members and bins come only now and then
    const soFar = progress.done ? [] : [["Generation", progress.generation], ["Best", progress.best], ["Evaluations", progress.evaluations]];
    const rows = /** @type {[string, any][]} */ ([...soFar, ["Seconds", progress.seconds]]);
    const parts = [figures(rows.filter(([, value]) => value != null).map(([name, value]) => [name, written(value)]))];
    if (progress.bins?.length > 1) parts.push(make("h3", {}, "Members in each range of the measure"), bars(progress.bins));
    if (progress.members?.length) {
      parts.push(make("h3", {}, progress.done ? "Members" : "Best family so far"), make("div", { class: "cards" }, ...progress.members.map((/** @type {Member} */ member) => memberCard(member, null))));
    }
    if (progress.done) {
      this.setRunning(false);
      const { run, error, stopped } = progress;
      if (error) this.message.textContent = messageOf(typeof error === "string" ? { message: error } : error);
      if (stopped && !run) parts.unshift(make("p", {}, "The search was stopped before it had a family."));
      if (run) parts.unshift(make("p", {}, `The search is over. Its result is the run ${run}. `, make("button", { type: "button", onclick: () => this.openRun(run) }, "Show the family")));
    }
    this.progress.replaceChildren(...parts);
  }
}

/** @param {{label: string, count: number}[]} bins */
function bars(bins) {
  const most = Math.max(3, ...bins.map((bin) => bin.count));
  return make("ul", { class: "bars" }, ...bins.map(({ label, count }) => {
    const bar = make("span", { class: "fill", "aria-hidden": "true" });
    bar.style.blockSize = `${(100 * count) / most}%`;
    return make("li", {}, make("span", { class: "column" }, bar), make("span", { class: "number" }, String(count)), make("span", { class: "quiet" }, label));
  }));
}
