// The page: opens the domain, shows one of four views, and remembers the view in the address.

import { make, messageOf } from "../../../envgraph/page/player.js";
import { connect, workerScript } from "./connection.js";
import { Domain } from "./domain.js";
import { EditView } from "./edit-view.js";
import { PlayView } from "./play-view.js";
import { FamilyView, SearchView } from "./run-view.js";
import { filesOfLink, linkWith } from "./share.js";

const byId = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** Return a button that switches between the light and the dark scheme, and remembers the choice. */
function themeButton() {
  const root = document.documentElement;
  const isDark = () => (root.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const button = make("button", { type: "button", onclick: () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    localStorage.setItem("envgraph-theme", root.dataset.theme);
    name();
  } });
  const name = () => { button.textContent = isDark() ? "Light" : "Dark"; };
  const stored = localStorage.getItem("envgraph-theme");
  if (stored === "light" || stored === "dark") root.dataset.theme = stored;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", name);
  name();
  return button;
}

/** @param {EditView} edit */
function shareButton(edit) {
  const button = make("button", { type: "button", onclick: async () => {
    const link = await linkWith(edit.editor.files);
    history.replaceState(null, "", link);
    await navigator.clipboard.writeText(link).catch(() => {}); // without permission the address bar still has the link
    byId("status").textContent = `The address now holds these files (${Math.ceil(link.length / 1000)} kB), and was copied.`;
  } }, "Share");
  return button;
}

/** Return a note that the page waits, which is hidden while it does not, with a button that stops this.
 * @param {import("./connection.js").Connection} connection */
function waitingNote(connection) {
  const stop = make("button", { type: "button", onclick: () => connection.stop() }, "Stop");
  const note = make("span", { class: "computing", hidden: true }, "Computing … ", ...(workerScript() ? [] : [stop])); // a worker hears nothing meanwhile
  setInterval(() => { note.hidden = !connection.isWaiting; }, 300);
  return note;
}

/** @param {Domain} domain */
function showViews(domain) {
  const edit = new EditView(domain);
  const play = new PlayView(domain, () => edit.models.value);
  const family = new FamilyView(domain, (member) => (play.playMember(member), show("play")));
  const search = new SearchView(domain, (run) => (family.opened = run, show("family")));
  const views = /** @type {Record<string, {title: string, view: {element: HTMLElement, show?: () => void}}>} */ ({
    edit: { title: "Edit", view: edit }, play: { title: "Play", view: play }, family: { title: "Family", view: family }, search: { title: "Search", view: search },
  });
  if (workerScript()) { // runs and searches need a server
    delete views.family;
    delete views.search;
  }
  const nav = byId("views");
  const show = (/** @type {string} */ name) => {
    byId("main").replaceChildren(views[name].view.element);
    byId("main").className = name;
    for (const link of nav.children) link.toggleAttribute("data-shown", /** @type {HTMLElement} */ (link).dataset.view === name);
    for (const link of nav.children) link.setAttribute("aria-current", /** @type {HTMLElement} */ (link).dataset.view === name ? "page" : "false");
    if (!location.hash.startsWith("#domain=")) history.replaceState(null, "", `#${name}`);
    views[name].view.show?.();
  };
  nav.replaceChildren(...Object.entries(views).map(([name, { title }]) => make("button", { type: "button", "data-view": name, onclick: () => show(name) }, title)));
  edit.element.addEventListener("problems", (/** @type {any} */ event) => {
    const count = event.detail;
    byId("status").textContent = count ? (count === 1 ? "1 problem" : `${count} problems`) : "";
  });
  if (workerScript()) byId("tools").prepend(shareButton(edit));
  const wanted = location.hash.slice(1);
  show(wanted in views ? wanted : domain.data.members.length ? "family" : "edit"); // members: the server was started on a run
}

async function start() {
  byId("tools").append(themeButton());
  try {
    const shared = await filesOfLink();
    const connection = await connect();
    connection.on("closed", () => {
      byId("status").replaceChildren("The connection was closed. ", make("button", { type: "button", onclick: () => location.reload() }, "Connect again"));
    });
    const data = await connection.request("page/open", shared ? { files: shared } : {});
    byId("title").textContent = data.title;
    document.title = `${data.title} – envgraph`;
    byId("tools").prepend(waitingNote(connection));
    showViews(new Domain(connection, data));
  } catch (error) {
    byId("main").replaceChildren(make("p", { class: "alert waiting", role: "alert" }, messageOf(error)));
  }
}

start();
