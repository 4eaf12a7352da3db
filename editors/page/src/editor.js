// The text editor: one view, a state for each file, and the language server behind it.

import { acceptCompletion, closeBrackets, closeBracketsKeymap, completionKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap, indentWithTab } from "@codemirror/commands";
import { bracketMatching, indentUnit } from "@codemirror/language";
import { lintGutter, lintKeymap, setDiagnostics } from "@codemirror/lint";
import {
  findReferencesKeymap, formatDocument, formatKeymap, hoverTooltips, jumpToDefinitionKeymap, LSPClient, LSPPlugin, renameKeymap,
  serverCompletion, signatureHelp, Workspace,
} from "@codemirror/lsp-client";
import { search, searchKeymap } from "@codemirror/search";
import { ChangeSet, EditorState } from "@codemirror/state";
import { drawSelection, EditorView, highlightActiveLine, keymap, lineNumbers } from "@codemirror/view";
import { highlighting, indentation, languageOf } from "./language.js";

/** @typedef {import("./types.js").TextFile} TextFile @typedef {import("./types.js").Diagnostic} Diagnostic */

const SEVERITIES = /** @type {const} */ (["error", "error", "warning", "info", "hint"]);

const LANGUAGES = ["metamodel", "query", "rules", "model", "environment"];

/** Files are listed in the order in which they import each other. @param {TextFile} file */
const orderOf = (file) => (LANGUAGES.indexOf(file.language) + 1 || LANGUAGES.length + 1);

const theme = EditorView.theme({
  "&": { height: "100%", color: "var(--ink)", backgroundColor: "var(--paper)", fontSize: "0.875rem" },
  "&.cm-focused": { outline: "none" }, // page.css draws a frame around all of the editor
  ".cm-scroller": { fontFamily: "var(--mono)", lineHeight: "1.55" },
  ".cm-content": { caretColor: "var(--ink)" },
  ".cm-cursor": { borderLeftColor: "var(--ink)", borderLeftWidth: "2px" },
  ".cm-gutters": { backgroundColor: "var(--paper)", color: "var(--quiet)", border: "none" },
  ".cm-activeLine": { backgroundColor: "var(--line-on)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { backgroundColor: "var(--selection)" },
  ".cm-tooltip, .cm-panels": { color: "var(--ink)", backgroundColor: "var(--raised)", border: "1px solid var(--edge)" },
  ".cm-tooltip": { borderRadius: "6px", maxWidth: "min(34rem, 90vw)" },
  ".cm-tooltip-autocomplete ul li[aria-selected]": { color: "var(--on-accent)", backgroundColor: "var(--accent)" },
  ".cm-diagnostic": { whiteSpace: "pre-wrap" },
  ".cm-textfield, .cm-button": { color: "var(--ink)", background: "var(--paper)", border: "1px solid var(--edge)", font: "inherit" },
});

const STRUCTURE = ["P", "PRE", "CODE", "SPAN", "EM", "STRONG", "UL", "OL", "LI", "BR", "BLOCKQUOTE", "H1", "H2", "H3", "H4", "HR"];

/** Return HTML in which all but text and its structure is shown as text: comments in files may contain any HTML.
 * @param {string} html */
function keepText(html) {
  const { body } = new DOMParser().parseFromString(html, "text/html");
  for (const element of body.querySelectorAll("*")) {
    if (!STRUCTURE.includes(element.tagName)) element.replaceWith(element.outerHTML);
    else for (const { name } of [...element.attributes]) if (name !== "class" || element.tagName !== "SPAN") element.removeAttribute(name);
  }
  return body.innerHTML;
}

/** A file that can be edited. While another file is shown, its state waits here. */
class OpenFile {
  /** @param {TextFile} file @param {EditorState} state */
  constructor(file, state) {
    this.uri = file.uri;
    this.name = file.name;
    this.languageId = file.language;
    this.saved = state.doc.toString(); // with other line ends than the file may have
    this.version = 0;
    this.state = state;
    this.doc = state.doc;
    /** @type {ChangeSet|null} */ this.unsynced = null;
    /** @type {EditorView|null} */ this.view = null;
    /** @type {Diagnostic[]} */ this.diagnostics = [];
  }

  getView() {
    return this.view;
  }

  get text() {
    return (this.view?.state ?? this.state).doc.toString();
  }

  get isChanged() {
    return this.text !== this.saved;
  }
}

/** All files of the folder are open for the language server, so that edits count before they are saved. */
class FolderWorkspace extends Workspace {
  /** @type {OpenFile[]} */ files = [];
  /** @type {(uri: string) => EditorView|null} */ show = () => null;
  changed = () => {};

  syncFiles() {
    const updates = [];
    for (const file of this.files) {
      const plugin = file.view && LSPPlugin.get(file.view);
      const changes = plugin ? plugin.unsyncedChanges : file.unsynced;
      if (!changes || changes.empty) continue;
      updates.push({ file, prevDoc: file.doc, changes });
      file.doc = (file.view?.state ?? file.state).doc;
      file.version += 1;
      file.unsynced = null;
      plugin?.clear();
    }
    return updates;
  }

  openFile() {} // all files are opened when the client connects, and stay open
  closeFile() {}

  /** @param {string} uri @param {import("@codemirror/state").TransactionSpec} update */
  updateFile(uri, update) {
    const file = /** @type {OpenFile|null} */ (this.getFile(uri));
    if (!file) return;
    if (file.view) return file.view.dispatch(update);
    const transaction = file.state.update(update);
    file.unsynced = file.unsynced ? file.unsynced.compose(transaction.changes) : transaction.changes;
    file.state = transaction.state;
    this.changed();
    setTimeout(() => this.client.sync());
  }

  /** @param {string} uri */
  async displayFile(uri) {
    return this.show(uri);
  }
}

export class TextEditor {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {import("./types.js").Domain} data
   * @param {{changed: () => void, diagnosed: () => void, save: () => void}} callbacks
   */
  constructor(connection, { files, rootUri }, callbacks) {
    this.callbacks = callbacks;
    this.client = new LSPClient({
      rootUri,
      sanitizeHTML: keepText,
      timeout: 20000, // a first check of a large domain takes longer than the three seconds of the library
      workspace: (client) => new FolderWorkspace(client),
      extensions: [
        serverCompletion(), hoverTooltips(), signatureHelp(), keymap.of([
          ...formatKeymap, ...renameKeymap, ...jumpToDefinitionKeymap, ...findReferencesKeymap]),
      ],
      notificationHandlers: {
        "textDocument/publishDiagnostics": (_, params) => this.receiveDiagnostics(params),
      },
    });
    this.workspace = /** @type {FolderWorkspace} */ (this.client.workspace);
    this.workspace.files = files.toSorted((one, other) => orderOf(one) - orderOf(other)).map((file) => new OpenFile(file, this.stateOf(file)));
    this.workspace.show = (uri) => this.show(uri);
    this.workspace.changed = () => callbacks.changed();
    this.element = document.createElement("div");
    this.element.className = "editor";
    /** @type {OpenFile|null} */ this.shown = null;
    this.view = new EditorView({ parent: this.element });
    this.client.connect(connection.languageTransport());
  }

  get files() {
    return this.workspace.files;
  }

  /** @param {TextFile} file */
  stateOf(file) {
    return EditorState.create({
      doc: file.text,
      extensions: [
        lineNumbers(), lintGutter(), history(), drawSelection(), bracketMatching(), closeBrackets(), highlightActiveLine(), search(),
        indentUnit.of("    "), indentation, languageOf(file.language), highlighting, theme,
        EditorView.contentAttributes.of({ "aria-label": `${file.name}. Escape, then Tab, leaves the editor.`, tabindex: "0" }),
        this.client.plugin(file.uri, file.language),
        keymap.of([
          { key: "Mod-s", preventDefault: true, run: () => (this.callbacks.save(), true) },
          ...closeBracketsKeymap, ...defaultKeymap, ...searchKeymap, ...historyKeymap, ...completionKeymap, ...lintKeymap,
          { key: "Tab", run: acceptCompletion }, indentWithTab,
        ]),
        EditorView.updateListener.of((update) => update.docChanged && this.textChanged()),
      ],
    });
  }

  textChanged() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.client.sync()); // envgraph itself waits for a pause before it checks
    this.callbacks.changed();
  }

  /** Show a file; return its view, or null if there is no such file.
   * @param {string} uri @param {import("./types.js").Position} [position] */
  show(uri, position) {
    const file = this.files.find((each) => each.uri === uri);
    if (!file) return null;
    if (file !== this.shown) {
      this.client.sync();
      if (this.shown) Object.assign(this.shown, { state: this.view.state, view: null });
      this.view.setState(file.state);
      file.view = this.view;
      this.shown = file;
      this.markDiagnostics(file);
      this.callbacks.changed();
    }
    if (position) {
      const line = this.view.state.doc.line(Math.min(position.line + 1, this.view.state.doc.lines));
      const anchor = Math.min(line.from + position.character, line.to);
      this.view.dispatch({ selection: { anchor }, effects: EditorView.scrollIntoView(anchor, { y: "center" }) });
      this.view.focus();
    }
    return this.view;
  }

  format() {
    formatDocument(this.view);
    this.view.focus();
  }

  /** @param {{uri: string, version?: number, diagnostics: Diagnostic[]}} params */
  receiveDiagnostics(params) {
    const file = this.files.find((each) => each.uri === params.uri);
    if (!file || (params.version != null && params.version < file.version)) return true;
    file.diagnostics = params.diagnostics;
    if (file === this.shown) this.markDiagnostics(file);
    this.callbacks.diagnosed();
    return true;
  }

  /** @param {OpenFile} file */
  markDiagnostics(file) {
    const plugin = LSPPlugin.get(this.view);
    if (!plugin) return;
    const place = (/** @type {import("./types.js").Position} */ position) => {
      const { lines } = plugin.syncedDoc;
      if (position.line >= lines) return plugin.unsyncedChanges.mapPos(plugin.syncedDoc.length);
      return plugin.unsyncedChanges.mapPos(plugin.fromPosition(position, plugin.syncedDoc));
    };
    this.view.dispatch(setDiagnostics(this.view.state, file.diagnostics.map((each) => ({
      from: place(each.range.start), to: place(each.range.end), severity: SEVERITIES[each.severity ?? 1], message: each.message,
    }))));
  }
}
