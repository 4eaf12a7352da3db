// Lists patterns and rules, walks through the matches of one, applies rules, and explains why nothing matches.

import { make, messageOf } from "../../../envgraph/page/player.js";
import { STOPPED } from "./connection.js";

/** @typedef {import("./types.js").Match} Match @typedef {{name: string, isRule: boolean, parameters: {name: string, type?: string}[]}} Entry */

const LIMIT = 100;

export class Definitions {
  /**
   * @param {import("./domain.js").Domain} domain
   * @param {{mark: (objects: number[]) => void, applied: (result: any) => void, open: (location: any) => void}} callbacks
   */
  constructor(domain, callbacks) {
    this.domain = domain;
    this.callbacks = callbacks;
    /** @type {Entry|null} */ this.chosen = null;
    /** @type {Match[]} */ this.matches = [];
    this.position = -1;
    this.round = 0;
    /** @type {Set<string>} */ this.slow = new Set(); // definitions whose matches are not counted again by themselves
    domain.addEventListener("changed", () => this.slow.clear());
    this.names = make("div", { class: "names" });
    this.detail = make("div", { class: "detail", "aria-live": "polite" });
    this.element = make("section", { class: "definitions", "aria-label": "Patterns and rules" }, this.names, this.detail);
  }

  /** Show the names anew, count their matches, and find those of the chosen definition again. */
  async refresh() {
    const round = ++this.round;
    const { patterns, rules } = this.domain.data;
    const entries = [
      ...patterns.map((each) => ({ name: each.name, isRule: false, parameters: each.parameters, doc: each.doc })),
      ...rules.map((each) => ({ name: each.name, isRule: true, parameters: each.parameters, doc: each.doc })),
    ];
    this.showNames(entries);
    const sameEntry = entries.find((each) => each.name === this.chosen?.name && each.isRule === this.chosen.isRule);
    if (sameEntry) await this.choose(sameEntry, false);
    else this.showEmpty();
    for (const entry of entries) {
      // Matches of patterns are counted without a list; of rules, those in the list are counted.
      const key = keyOf(entry);
      const found = this.slow.has(key) ? null : await this.find(entry, entry.isRule ? LIMIT : 0).catch((error) => {
        if (error.code === STOPPED) this.slow.add(key);
        return null;
      });
      if (round !== this.round) return;
      const count = this.names.querySelector(`[data-key="${CSS.escape(keyOf(entry))}"] .count`);
      if (count) count.textContent = found ? countOf(entry, found) : "?";
    }
  }

  /** @param {(Entry & {doc?: string})[]} entries */
  showNames(entries) {
    const shortNames = entries.map((each) => `${each.isRule} ${shortName(each.name)}`);
    const nameOf = (/** @type {Entry} */ each) =>
      shortNames.filter((name) => name === `${each.isRule} ${shortName(each.name)}`).length > 1 ? each.name : shortName(each.name);
    const focused = /** @type {HTMLElement|null} */ (this.names.querySelector(":focus"))?.dataset.key;
    const list = (/** @type {string} */ title, /** @type {boolean} */ isRule) => !entries.some((each) => each.isRule === isRule) ? [] : [
      make("h3", {}, title),
      make("ul", {}, ...entries.filter((each) => each.isRule === isRule).map((each) => make("li", {}, make("button", {
        type: "button", "data-key": keyOf(each), title: [each.name, each.doc].filter(Boolean).join("\n"), "aria-pressed": String(keyOf(each) === keyOf(this.chosen)),
        onclick: () => this.choose(each, true),
      }, make("span", { class: "name" }, nameOf(each)), make("span", { class: "count" }, "…"))))),
    ];
    this.names.replaceChildren(...list("Patterns", false), ...list("Rules", true));
    if (focused) this.names.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
  }

  /** @param {Entry} entry @param {number} limit @returns {Promise<import("./types.js").Matches>} */
  find(entry, limit) {
    const { connection } = this.domain;
    if (entry.isRule) return connection.request("page/applicable", { rule: entry.name, limit });
    return connection.request("page/matches", { pattern: entry.name, limit });
  }

  /** Show the matches of a definition. @param {Entry} entry @param {boolean} fromStart mark the first match */
  async choose(entry, fromStart) {
    this.chosen = entry;
    for (const button of this.names.querySelectorAll("button")) {
      button.setAttribute("aria-pressed", String(button.dataset.key === keyOf(entry)));
    }
    try {
      const found = await this.find(entry, LIMIT);
      if (this.chosen !== entry) return;
      this.matches = found.matches;
      this.version = found.version;
      this.showMatches(entry, found);
      if (!found.count) await this.explain(entry);
      // A rule is marked only when one of its matches is looked at: after each application the picture should be calm.
      this.goTo(found.matches.length && (fromStart || (this.position >= 0 && !entry.isRule)) ? Math.max(0, Math.min(this.position, found.matches.length - 1)) : -1, fromStart);
    } catch (error) {
      this.detail.replaceChildren(make("p", { class: "alert" }, messageOf(error)));
    }
  }

  showEmpty() {
    this.chosen = null;
    this.callbacks.mark([]);
    const { patterns, rules } = this.domain.data;
    const text = patterns.length + rules.length ? "Choose a pattern to see its matches in the picture, or a rule to apply it." : "There are no patterns and no rules yet.";
    this.detail.replaceChildren(make("p", { class: "quiet" }, text));
  }

  /** @param {Entry} entry @param {import("./types.js").Matches} found */
  showMatches(entry, found) {
    const step = (/** @type {string} */ text, /** @type {string} */ label, /** @type {number} */ by) => make("button", {
      type: "button", "aria-label": label,
      onclick: () => this.goTo((this.position + by + this.matches.length) % this.matches.length, true),
    }, text);
    this.number = `${countOf(entry, found)} ${countOf(entry, found) === "1" ? "match" : "matches"}`;
    this.where = make("span", { class: "where" }, this.number);
    const walk = found.matches.length > 1 ? [step("‹", "Previous match", -1), step("›", "Next match", 1)] : [];
    const close = make("button", { type: "button", "aria-label": "Close", onclick: () => this.close() }, "×");
    const head = [
      make("div", { class: "detail-head" }, make("h3", {}, shortName(entry.name)), close), make("div", { class: "detail-head" }, this.where, ...walk)];
    const items = found.matches.map((match, position) => make("li", {}, make("button", {
      type: "button", "aria-pressed": "false",
      onclick: () => (entry.isRule ? this.apply(entry, match) : this.goTo(position, true)),
      onmouseenter: () => this.goTo(position, false), onfocus: () => this.goTo(position, false),
    }, ...(entry.isRule ? [make("span", { class: "verb" }, "Apply")] : []), describeMatch(match))));
    const rest = found.more ? [make("p", { class: "quiet" }, `Only the first ${found.matches.length} are listed.`)] : [];
    this.list = make("ul", { class: "matches" }, ...items);
    this.detail.replaceChildren(...head, ...(items.length ? [this.list] : []), ...rest);
  }

  close() {
    this.names.querySelector('[aria-pressed="true"]')?.focus();
    for (const button of this.names.querySelectorAll("button")) button.setAttribute("aria-pressed", "false");
    this.showEmpty();
  }

  /** Mark one match in the picture. @param {number} position @param {boolean} scroll */
  goTo(position, scroll) {
    this.position = position;
    this.callbacks.mark(this.matches[position]?.objects ?? []);
    if (this.where) this.where.textContent = position < 0 || this.matches.length < 2 ? this.number : `${position + 1} of ${this.number}`;
    [...(this.list?.children ?? [])].forEach((item, each) => {
      const button = /** @type {HTMLElement} */ (item.firstElementChild);
      button.setAttribute("aria-pressed", String(each === position));
      if (scroll && each === position) button.scrollIntoView({ block: "nearest" });
    });
  }

  /** @param {Entry} entry @param {Match} match */
  async apply(entry, match) {
    try {
      const { version } = this;
      this.callbacks.mark([]);
      this.position = -1;
      this.callbacks.applied(await this.domain.connection.request("page/apply", { rule: entry.name, index: match.index, version }));
    } catch (error) {
      this.detail.prepend(make("p", { class: "alert", role: "alert" }, messageOf(error)));
    }
  }

  /** @param {Entry} entry */
  async explain(entry) {
    const { text, spans } = await this.domain.connection.request("page/whyNot", { name: entry.name });
    if (this.chosen !== entry) return;
    const places = (spans ?? []).map((/** @type {any} */ span) => make("button", { type: "button", onclick: () => this.callbacks.open(span) },
      `${span.uri.split("/").pop()}, line ${span.range.start.line + 1}`));
    this.detail.append(make("h4", {}, "Why not?"), make("pre", { class: "why", tabindex: "0" }, text), make("p", { class: "places" }, ...places));
  }
}

/** @param {Entry|null} entry */
const keyOf = (entry) => (entry ? `${entry.isRule ? "rule" : "pattern"} ${entry.name}` : "");

/** @param {string} name */
const shortName = (name) => name.split(".").pop() ?? name;

/** @param {Entry} entry @param {import("./types.js").Matches} found */
const countOf = (entry, found) => `${found.count}${entry.isRule && found.more ? "+" : ""}`;

/** @param {Match} match */
const describeMatch = (match) => Object.entries(match.values).map(([name, value]) => `${name} = ${value}`).join(", ") || "here";
