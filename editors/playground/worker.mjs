// Runs envgraph in this worker: takes the messages of the page, and answers them as `envgraph serve` does.

import { inflate, startPython } from "./python.mjs";

const PAUSE = 50; // milliseconds without a message after which edited texts are checked: messages wait for a check

const waiting = [];
let wake = () => {};
self.onmessage = ({ data }) => (waiting.push(data), wake());

/** Return the content of a file beside this one. */
async function load(path) {
  const response = await fetch(new URL(path, import.meta.url));
  if (!response.ok) throw new Error(`${response.url} cannot be loaded.`);
  return inflate(new Uint8Array(await response.arrayBuffer()));
}

async function answerMessages() {
  const name = new URLSearchParams(location.search).get("domain") ?? "maze";
  const unknown = () => { throw new Error(`The domain ${name} cannot be loaded. Choose one on the first page of the playground.`); };
  const [python, domain] = await Promise.all([startPython(load), load(`domains/${encodeURIComponent(name)}.json`).catch(unknown)]);
  const send = (text) => self.postMessage(text);
  const playground = python.globals.get("Playground")(send, name, new TextDecoder().decode(domain));
  for (;;) {
    while (waiting.length) playground.receive(waiting.shift());
    await new Promise((resolve) => { wake = resolve; setTimeout(resolve, PAUSE); });
    if (!waiting.length && !playground.work()) await new Promise((resolve) => { wake = resolve; });
  }
}

answerMessages().catch((error) => setTimeout(() => { throw error; })); // so that the page hears of it
