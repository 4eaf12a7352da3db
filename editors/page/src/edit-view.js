// The view "Edit": texts on one side, the model, its patterns and its rules on the other.

import { make, messageOf } from "../../../envgraph/page/player.js";
import { Definitions } from "./definitions.js";
import { TextEditor } from "./editor.js";
import { ModelPicture } from "./picture.js";

const PANES = [["text", "Text"], ["picture", "Picture"], ["definitions", "Patterns and rules"]];

export class EditView {
  /** @param {import("./domain.js").Domain} domain */
  constructor(domain) {
    this.domain = domain;
    this.connection = domain.connection;
    this.editor = new TextEditor(this.connection, domain.data, {
      changed: () => this.showFiles(), diagnosed: () => this.showProblems(), save: () => this.save(),
    });
    this.picture = new ModelPicture();
    this.definitions = new Definitions(domain, {
      mark: (objects) => this.picture.mark(objects),
      applied: (result) => this.showPicture(result.picture, result.changes),
      open: (place) => this.open(place.uri, place.range.start),
    });
    this.element = make("div", { class: "edit", "data-pane": "text" }, this.buildPaneSwitch(), this.buildTextPane(), this.buildModelPane());
    domain.addEventListener("changed", () => this.refresh());
    window.addEventListener("beforeunload", (event) => this.editor.files.some((file) => file.isChanged) && event.preventDefault());
    this.start();
  }

  async start() {
    const { files, models } = this.domain.data;
    const first = files.find((file) => file.language === "rules") ?? files[0];
    if (first) this.editor.show(first.uri);
    else this.alert.textContent = "This folder has no files of envgraph. `envgraph new maze` writes a domain to start from.";
    this.showState();
    this.showFiles();
    this.showModels();
    this.editor.client.initializing.then(() => this.showProblems());
    if (models.length) await this.ask("page/picture");
    await this.definitions.refresh();
  }

  buildPaneSwitch() {
    return make("div", { class: "panes", role: "group", "aria-label": "Panes" }, ...PANES.map(([pane, title]) =>
      make("button", { type: "button", "data-pane": pane, "aria-pressed": String(pane === "text"), onclick: () => this.showPane(pane) }, title)));
  }

  /** @param {string} pane */
  showPane(pane) {
    this.element.dataset.pane = pane;
    for (const button of this.element.querySelectorAll(".panes button")) button.setAttribute("aria-pressed", String(button.dataset.pane === pane));
    this.picture.mark(this.picture.marked); // a hidden picture has no places to mark
  }

  buildTextPane() {
    this.fileList = make("div", { class: "files", role: "group", "aria-label": "Files" });
    this.saveButton = make("button", { type: "button", title: "Save this file (Ctrl+S)", onclick: () => this.save() }, "Save");
    const format = make("button", { type: "button", title: "Format this file (Shift+Alt+F)", onclick: () => this.editor.format() }, "Format");
    this.problems = make("div", { class: "problems" });
    this.alert = make("p", { class: "alert", role: "alert" });
    const keys = make("p", { class: "keys quiet" }, "Ctrl+Space completes · F12 goes to the definition · F2 renames · Shift+Alt+F formats · Ctrl+S saves");
    return make("section", { class: "pane text-pane", "aria-label": "Texts" },
      make("div", { class: "bar" }, this.fileList, make("span", { class: "buttons" }, format, this.saveButton)),
      this.editor.element, this.alert, this.problems, keys);
  }

  buildModelPane() {
    this.models = make("select", { "aria-label": "Model", onchange: () => this.ask("page/select", { model: this.models.value }) });
    const button = (/** @type {string} */ text, /** @type {string} */ method) =>
      make("button", { type: "button", disabled: true, onclick: () => this.ask(method) }, text);
    this.undo = button("Undo", "page/undo");
    this.redo = button("Redo", "page/redo");
    this.reset = button("Reset", "page/reset");
    this.note = make("p", { class: "stale", hidden: true });
    this.stale = make("p", { class: "stale", hidden: true });
    this.applied = make("ol", { class: "steps" });
    this.history = make("details", { hidden: true }, make("summary", {}, "Applied rules"), this.applied);
    this.changes = make("p", { class: "changes", "aria-live": "polite" });
    return make("div", { class: "model-panes" },
      make("section", { class: "pane picture-section", "aria-label": "Model" },
        make("div", { class: "bar" }, this.models, make("span", { class: "buttons" }, this.picture.enlarge, this.undo, this.redo, this.reset)),
        this.stale, this.note, this.picture.element, this.changes, this.history),
      this.definitions.element);
  }

  showModels() {
    const { models } = this.domain.data;
    const chosen = this.models.value;
    this.models.replaceChildren(...models.map((model) => make("option", { value: model.name, selected: model.name === chosen }, model.name)));
    this.models.hidden = models.length < 2;
  }

  /** Show why the picture does not show the current texts. */
  showState() {
    const { errors, files, models } = this.domain.data;
    const shown = models.length ? "This is the last state without errors." : "The model is shown when they have none.";
    const text = errors && files.length ? `The texts have errors. ${shown}` : models.length ? "" : "There is no model yet. Write one in a file that ends with .model.";
    this.stale.hidden = !text;
    this.stale.textContent = text;
  }

  async refresh() {
    this.showState();
    if (this.domain.data.errors) return;
    this.showModels();
    if (this.domain.data.models.length) await this.ask("page/picture");
    await this.definitions.refresh();
  }

  /** Change the model or ask for its picture, and show it. @param {string} method @param {object} [params] */
  async ask(method, params = {}) {
    try {
      await this.showPicture(await this.connection.request(method, params), []);
      if (method !== "page/picture") await this.definitions.refresh();
    } catch (error) {
      this.changes.textContent = messageOf(error);
    }
  }

  /** @param {import("./types.js").Picture} picture @param {string[]} changes */
  async showPicture(picture, changes) {
    this.undo.disabled = !picture.canUndo;
    this.redo.disabled = !picture.canRedo;
    this.reset.disabled = !picture.canUndo;
    this.note.hidden = !picture.note;
    this.note.textContent = picture.note ?? "";
    if (picture.model) this.models.value = picture.model;
    this.history.hidden = !picture.steps.length;
    this.applied.replaceChildren(...picture.steps.map((step) => make("li", {}, step)));
    this.changes.textContent = changes.length ? changes.slice(0, 6).join("; ") + (changes.length > 6 ? `; and ${changes.length - 6} more changes` : "") : "";
    await this.picture.show(picture, `Model ${picture.model ?? ""}`);
    if (changes.length) await this.definitions.refresh();
  }

  /** @param {string} uri @param {import("./types.js").Position} position */
  open(uri, position) {
    this.showPane("text");
    this.editor.show(uri, position);
  }

  showFiles() {
    const { files, shown } = this.editor;
    if (this.fileList.children.length !== files.length) {
      this.fileList.replaceChildren(...files.map((file) => make("button", { type: "button", onclick: () => this.editor.show(file.uri) })));
    }
    files.forEach((file, index) => {
      const button = this.fileList.children[index];
      button.setAttribute("aria-pressed", String(file === shown));
      if (file === shown) requestAnimationFrame(() => { this.fileList.scrollLeft = button.offsetLeft - 40; }); // on a phone the list is one line
      button.replaceChildren(file.name, ...(file.isChanged ? [make("span", { class: "unsaved", title: "not saved" }, "●")] : []));
    });
    this.saveButton.disabled = !shown?.isChanged;
  }

  showProblems() {
    const all = this.editor.files.flatMap((file) => file.diagnostics.map((each) => ({ file, each })));
    const items = all.map(({ file, each }) => make("li", {}, make("button", {
      type: "button", class: each.severity === 1 || !each.severity ? "error" : "warning", onclick: () => this.open(file.uri, each.range.start),
    }, make("span", { class: "place" }, `${file.name}:${each.range.start.line + 1}`), make("span", {}, each.message))));
    const count = all.length === 1 ? "1 problem" : `${all.length} problems`;
    this.problems.replaceChildren(make("h3", { role: "status" }, all.length ? count : "No problems"), make("ul", {}, ...items));
    this.element.dispatchEvent(new CustomEvent("problems", { detail: all.length }));
  }

  /** Return a question about a file that another program has changed. @param {any} file @param {string} changed its text now */
  askAboutChange(file, changed) {
    const answer = (/** @type {string} */ title, /** @type {() => void} */ act) => make("button", { type: "button", onclick: () => {
      file.saved = changed.replaceAll(/\r\n?/g, "\n");
      this.alert.replaceChildren();
      this.editor.show(file.uri);
      act();
    } }, title);
    const takeOther = () => this.editor.view.dispatch({ changes: { from: 0, to: this.editor.view.state.doc.length, insert: changed } });
    return [`Another program has changed ${file.name} since it was read here. It was not saved. `,
      answer("Save this text", () => this.save()), " ", answer("Take the other text", takeOther)];
  }

  async save() {
    const file = this.editor.shown;
    if (!file) return;
    const { text } = file;
    try {
      const { changed } = await this.connection.request("page/save", { uri: file.uri, text, was: file.saved });
      if (changed === undefined) file.saved = text;
      this.alert.replaceChildren(...(changed === undefined ? [] : this.askAboutChange(file, changed)));
    } catch (error) {
      this.alert.textContent = messageOf(error);
    }
    this.showFiles();
  }
}
