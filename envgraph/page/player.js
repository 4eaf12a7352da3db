// Plays an environment: a picture, a button for each action, keys, undo, policies, and what ended the episode.
// No dependencies, because the page and the widget for notebooks both load this module.

/**
 * @typedef {{name: string, keys?: string[], allowed: boolean}} Action
 * @typedef {{solvable?: boolean|null, shortest?: number|null, optimal?: number|null, value?: number|null, discount?: number|null, randomWalk?: number|null, text?: string}} Best
 * @typedef {{
 *   picture: {svg?: string, text?: string}, observation?: unknown, actions: Action[], agent?: string|null, title?: string,
 *   steps: number, limit?: number|null, reward: number, rewards?: Record<string, number>|null, total: number,
 *   terminated: boolean, truncated: boolean, end?: string|null, reason?: string|null,
 *   chosen?: number|null, values?: (number|null)[]|null, best?: Best|null}} State
 * @typedef {{environment?: string, model?: string, member?: string, seed?: number}} Start
 * @typedef {{request: (method: string, params?: object) => Promise<any>}} Connection
 */

const PAUSE = 350; // milliseconds between two steps of a policy that runs
const WAITING = 4; // key presses that are remembered while a step is computed

/**
 * Return an element with attributes, listeners (`onclick: f`) and children.
 * @param {string} tag
 * @param {Record<string, any>} [attributes]
 * @param {...(Node|string)} children
 * @returns {any}
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/**
 * Return a number as people write it: a few digits, no zeros at the end, a real minus sign.
 * @param {number|null|undefined} number
 * @param {number} [digits]
 */
export function formatNumber(number, digits = 6) {
  if (number == null) return "–";
  if (!Number.isFinite(number)) return number > 0 ? "∞" : number < 0 ? "−∞" : "undefined";
  const small = number !== 0 && Math.abs(number) < 0.0001;
  return (small ? number.toExponential(1) : String(Number(number.toPrecision(digits)))).replace("-", "−").replace("e−", "e-");
}

/**
 * Return one line about how good an environment can be played.
 * @param {Best|null|undefined} best
 */
export function describeBest(best) {
  if (!best) return "";
  if (best.text) return best.text.replace(/e-(?=\d)/g, "e\u2011"); // a hyphen that ends no line
  const parts = [];
  if (best.solvable === false) parts.push("not solvable");
  else if (best.shortest != null) parts.push(`solvable in ${best.shortest} ${best.shortest === 1 ? "step" : "steps"}`);
  else if (best.solvable) parts.push("solvable");
  if (best.optimal != null) parts.push(`best return ${formatNumber(best.optimal)}`);
  if (best.randomWalk != null) parts.push(`a random walk succeeds with probability ${formatNumber(best.randomWalk)}`);
  const line = parts.join(", ");
  return line && line[0].toUpperCase() + line.slice(1) + ".";
}

const KEY_NAMES = /** @type {Record<string, string>} */ ({
  ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", " ": "Space", Escape: "Esc",
});

/** @param {string} key */
const keyName = (key) => KEY_NAMES[key] ?? (key.length === 1 ? key.toUpperCase() : key);

/**
 * Replace the content of an element by an SVG picture. Text that is not SVG is not shown.
 * @param {Element} element
 * @param {string|undefined} svg
 * @param {string} label the name that screen readers read
 * @returns {Element|null}
 */
export function showSvg(element, svg, label) {
  const root = svg ? new DOMParser().parseFromString(svg, "image/svg+xml").documentElement : null;
  if (!root || root.nodeName !== "svg") {
    element.replaceChildren();
    return null;
  }
  root.setAttribute("role", "img");
  root.setAttribute("aria-label", label);
  root.querySelector(":scope > title")?.remove(); // would cover the picture with a tooltip
  element.replaceChildren(document.importNode(root, true));
  return element.firstElementChild;
}

/**
 * Return an error as people read it: a sentence, and what to do.
 * @param {any} error
 */
export function messageOf(error) {
  const text = error.message ?? String(error);
  const isWord = /^[a-z]+ /.test(text); // and not a path
  const sentence = (isWord ? text.charAt(0).toUpperCase() + text.slice(1) : text) + (/[.!?]$/.test(text) ? "" : ".");
  return error.hint ? `${sentence} Hint: ${error.hint}` : sentence;
}

/** The state and the elements of one player. */
class Player {
  /**
   * @param {Element} element
   * @param {Connection} connection
   * @param {Start} start
   */
  constructor(element, connection, start) {
    this.connection = connection;
    this.startParameters = start;
    /** @type {State|null} */ this.state = null;
    this.certificate = "";
    this.certified = "";
    this.running = false;
    this.last = Promise.resolve();
    this.waiting = 0;
    this.build(element);
  }

  /** @param {Element} element */
  build(element) {
    const button = (/** @type {string} */ text, /** @type {() => void} */ action, /** @type {string} */ hint = "") =>
      make("button", { type: "button", class: "eg-button", onclick: action, title: hint }, text);
    this.stage = make("div", { class: "eg-stage", tabindex: "0", role: "group", "aria-label": "Picture of the episode; keys act here" });
    this.agent = make("p", { class: "eg-agent", hidden: true });
    this.figures = make("dl", { class: "eg-figures" });
    this.outcome = make("p", { class: "eg-outcome", hidden: true });
    this.best = make("p", { class: "eg-best", role: "status" });
    this.actions = make("div", { class: "eg-actions", role: "group", "aria-label": "Actions" });
    this.undoButton = button("Undo", () => this.undo(), "Undo the last step (U)");
    this.restartButton = button("Restart", () => this.start(), "Start the episode again (R)");
    this.policy = make("select", { class: "eg-select", "aria-label": "Policy" },
      make("option", { value: "best" }, "Best policy"), make("option", { value: "random" }, "Random policy"));
    this.stepButton = button("Step", () => this.followPolicy(), "Let the policy do one step");
    this.runButton = button("Run", () => (this.running ? this.pause() : this.run()), "Let the policy play until the end");
    this.text = make("pre", { class: "eg-text", tabindex: "0" });
    this.alert = make("p", { class: "eg-alert", role: "alert" });
    this.live = make("p", { class: "eg-live", "aria-live": "polite" });
    this.root = make("div", { class: "eg-player", onkeydown: (/** @type {KeyboardEvent} */ event) => this.onKey(event) },
      this.stage,
      make("div", { class: "eg-side" }, this.agent, this.outcome, this.figures, this.alert, this.actions,
        make("div", { class: "eg-row" }, this.undoButton, this.restartButton),
        make("div", { class: "eg-row", role: "group", "aria-label": "Policy" }, this.policy, this.stepButton, this.runButton),
        this.best,
        make("details", {}, make("summary", {}, "Picture as text"), this.text)),
      this.live);
    element.replaceChildren(this.root);
  }

  /**
   * Do one thing after the other, and show what goes wrong. Nothing is remembered while too much waits already.
   * @param {() => Promise<void>} work
   */
  enqueue(work) {
    if (this.waiting >= WAITING) return this.last;
    this.waiting += 1;
    this.last = this.last.then(work).then(() => { this.alert.textContent = ""; }, (error) => {
      this.running = false;
      this.alert.textContent = messageOf(error);
      this.show();
    }).finally(() => { this.waiting -= 1; });
    return this.last;
  }

  /** @param {string} method @param {object} [params] */
  async ask(method, params = {}) {
    this.state = await this.connection.request(method, params);
    this.show();
  }

  /** @param {Start} [parameters] */
  start(parameters) {
    this.running = false;
    if (parameters) this.startParameters = parameters;
    return this.enqueue(async () => {
      await this.ask("page/play/start", { seed: 0, ...this.startParameters });
      this.live.textContent = "Episode started.";
      this.certify();
    });
  }

  /** Ask what the best policy reaches in this level, and show it. The answer may take seconds, so nothing waits for it. */
  async certify() {
    const asked = JSON.stringify({ ...this.startParameters, seed: 0 });
    if (asked === this.certified) return;
    this.certified = asked;
    this.certificate = "Computing what the best policy reaches …";
    this.show();
    const text = await this.connection.request("page/certificate", this.startParameters).then(describeBest, messageOf);
    if (asked !== this.certified) return;
    this.certificate = text;
    this.show();
  }

  get ended() {
    return !this.state || this.state.terminated || this.state.truncated;
  }

  /** @param {number} index */
  act(index) {
    this.running = false;
    return this.enqueue(async () => {
      const action = this.state?.actions[index];
      if (this.ended || !action?.allowed) return;
      await this.ask("page/play/step", { action: index });
      this.announce(action.name);
    });
  }

  undo() {
    this.running = false;
    return this.enqueue(async () => {
      if (!this.state?.steps) return;
      await this.ask("page/play/undo");
      this.live.textContent = `Undone. ${this.state.steps} steps.`;
    });
  }

  followPolicy() {
    return this.enqueue(async () => {
      if (this.ended) return;
      const before = this.state?.actions ?? [];
      await this.ask("page/play/policy", { policy: this.policy.value });
      this.announce(before[this.state?.chosen ?? -1]?.name ?? "step");
    });
  }

  async run() {
    await this.last; // the episode may be starting
    this.running = true;
    this.show();
    while (this.running && !this.ended && this.root.isConnected) {
      await this.followPolicy();
      await new Promise((resolve) => setTimeout(resolve, PAUSE));
    }
    this.pause();
  }

  pause() {
    this.running = false;
    this.show();
  }

  /** @param {string} action */
  announce(action) {
    const { reward, total } = /** @type {State} */ (this.state);
    const end = this.outcome.hidden ? "" : ` ${this.outcome.textContent}`;
    this.live.textContent = `${action}: reward ${formatNumber(reward)}, return ${formatNumber(total)}.${end}`;
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    const target = /** @type {Element} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey || target.closest("select, input, textarea, pre")) return;
    if ((event.key === " " || event.key === "Enter") && target.closest("button, summary")) return;
    const actions = this.state?.actions ?? [];
    const bound = (/** @type {Action} */ action) => action.keys?.includes(event.key);
    const index = actions.findIndex((action) => bound(action) && action.allowed);
    if (index >= 0) this.act(index);
    else if (actions.some(bound)) this.live.textContent = "This action is not possible now.";
    else if (event.key === "u") this.undo();
    else if (event.key === "r") this.start();
    else return;
    event.preventDefault();
  }

  show() {
    const state = this.state;
    if (!state) return;
    const title = state.title ?? "The episode";
    showSvg(this.stage, state.picture.svg, `${title} after ${state.steps} steps`);
    if (!this.stage.firstChild) this.stage.append(make("pre", {}, state.picture.text ?? ""));
    this.text.textContent = state.picture.text ?? "";
    this.agent.hidden = !state.agent;
    this.agent.textContent = state.agent ? `Next to act: ${state.agent}` : "";
    const { value, discount } = state.best ?? {};
    const here = value == null ? "" : ` From here the best policy expects ${formatNumber(value, 4)}, if each step discounts by ${discount}.`;
    const numbers = state.values ? " The numbers on the actions are such values, too." : "";
    this.best.textContent = this.certificate + here + numbers;
    this.showFigures(state);
    this.showOutcome(state);
    this.showActions(state);
    this.undoButton.disabled = !state.steps;
    this.stepButton.disabled = this.ended;
    this.runButton.disabled = this.ended;
    this.runButton.textContent = this.running ? "Pause" : "Run";
  }

  /** @param {State} state */
  showFigures(state) {
    const steps = state.limit ? `${state.steps} of ${state.limit}` : String(state.steps);
    const figures = [["Steps", steps], ["Reward", formatNumber(state.reward)], ["Return", formatNumber(state.total)]];
    for (const [name, value] of Object.entries(state.rewards ?? {})) figures.push([name, formatNumber(value)]);
    this.figures.replaceChildren(...figures.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
  }

  /** @param {State} state */
  showOutcome(state) {
    this.outcome.hidden = !this.ended;
    const kind = state.truncated ? "The episode was cut off" : state.end ? `The episode ended with ${state.end}` : "The episode is over";
    this.outcome.replaceChildren(state.reason ? `${kind}: ` : `${kind}.`, ...(state.reason ? [make("code", {}, state.reason)] : []));
  }

  /** @param {State} state */
  showActions(state) {
    const names = state.actions.map((action) => action.name).join("\n");
    if (names !== this.actions.dataset.names) {
      this.actions.dataset.names = names;
      this.actions.replaceChildren(...state.actions.map((action, index) => {
        const keys = (action.keys ?? []).map((key) => make("kbd", {}, keyName(key)));
        return make("button", { type: "button", class: "eg-button", onclick: () => this.act(index) },
          make("span", {}, action.name), ...keys, make("span", { class: "eg-value" }));
      }));
    }
    // Not `disabled`: a button that has the focus would lose it, and keys would no longer reach the player.
    state.actions.forEach((action, index) => {
      const button = this.actions.children[index];
      button.setAttribute("aria-disabled", String(this.ended || !action.allowed));
      button.classList.toggle("eg-chosen", index === state.chosen);
      button.querySelector(".eg-value").textContent = state.values?.[index] == null ? "" : formatNumber(state.values[index], 3);
    });
  }
}

/**
 * Show a player in an element, and start an episode.
 * @param {Element} element its content is replaced
 * @param {Connection} connection where the `page/play/..` requests go
 * @param {Start & {start?: boolean}} [options] what is played; `start: false` waits for the method `start`
 * @returns {{start: (parameters?: Start) => Promise<void>, focus: () => void, destroy: () => void}}
 */
export function mountPlayer(element, connection, options = {}) {
  const { start = true, ...parameters } = options;
  const player = new Player(element, connection, parameters);
  if (start) player.start();
  return {
    start: (parameters) => player.start(parameters),
    focus: () => player.stage.focus(),
    destroy: () => { player.running = false; player.root.remove(); },
  };
}
