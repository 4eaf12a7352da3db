// The view "Play": an environment and a model are chosen, and played by keys, buttons or a policy.

import { make, mountPlayer } from "../../../envgraph/page/player.js";

export class PlayView {
  /** @param {import("./domain.js").Domain} domain @param {() => string} shownModel the model that the view "Edit" shows */
  constructor(domain, shownModel) {
    this.domain = domain;
    this.shownModel = shownModel;
    this.isChosen = false; // until a person chooses a level, that of the view "Edit" is played
    this.environment = make("select", { onchange: () => this.start() });
    this.level = make("select", { onchange: () => (this.isChosen = true, this.start()) });
    this.seed = make("input", { type: "number", value: "0", min: "0", step: "1", onchange: () => this.start() });
    this.stage = make("div", { class: "stage" });
    this.form = make("form", { class: "choices", onsubmit: (/** @type {Event} */ event) => event.preventDefault() },
        make("label", {}, "Environment", this.environment), make("label", {}, "Level", this.level), make("label", {}, "Seed", this.seed));
    this.element = make("div", { class: "play" }, this.form, this.stage);
    domain.addEventListener("changed", () => this.showChoices());
    this.showChoices();
  }

  showChoices() {
    const { environments, models } = this.domain.data;
    const [environment, level] = [this.environment.value, this.isChosen ? this.level.value : `model ${this.shownModel()}`];
    const option = (/** @type {string} */ value, /** @type {string} */ text, /** @type {string} */ chosen) =>
      make("option", { value, selected: value === chosen }, text);
    this.environment.replaceChildren(...environments.map(({ name }) => option(name, name, environment)));
    this.level.replaceChildren(
      ...models.map(({ name }) => option(`model ${name}`, name, level)),
      ...this.domain.members.map((name) => option(`member ${name}`, `member ${name}`, level)));
    this.form.hidden = !environments.length;
    if (!environments.length) this.stage.replaceChildren(make("p", { class: "quiet" }, "This domain has no environment. Write one in a file that ends with .environment."));
  }

  /** Called when the view is shown. */
  show() {
    this.showChoices();
    if (!this.domain.data.environments.length) return;
    if (this.started !== this.choice) this.start(); // otherwise the episode goes on
    this.player?.focus(); // keys act at once
  }

  /** @param {string} member play a member of the open run */
  playMember(member) {
    this.showChoices();
    this.isChosen = true;
    this.level.value = `member ${member}`;
  }

  /** The choice of the level as text. If the text changes, another episode begins. */
  get choice() {
    return JSON.stringify([this.environment.value, this.level.value, this.seed.value, this.domain.data.version]);
  }

  start() {
    this.started = this.choice;
    const [kind, ...words] = this.level.value.split(" ");
    const level = kind ? { [kind]: words.join(" ") } : {};
    const parameters = { environment: this.environment.value, seed: Number(this.seed.value) || 0, ...level };
    if (this.player) this.player.start(parameters);
    else this.player = mountPlayer(this.stage, this.domain.connection, parameters);
  }
}
