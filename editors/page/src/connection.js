// JSON-RPC 2.0 over one of two transports: a WebSocket of `envgraph serve`, or a worker that runs envgraph in the browser.

/**
 * A transport sends and receives texts; each text is one message.
 * @typedef {{send: (text: string) => void, onText: (text: string) => void, onClose: (reason?: string) => void}} TextTransport
 */

/** The code of the error of a request that was stopped. */
export const STOPPED = -32800;

/** An error that the other side answered. */
export class RequestError extends Error {
  /** @param {{code?: number, message: string, hint?: string, spans?: any[], data?: any}} error */
  constructor(error) {
    super(error.message);
    this.code = error.code;
    this.hint = error.hint ?? error.data?.hint ?? "";
    this.spans = error.spans ?? error.data?.spans ?? [];
  }
}

/** Sends requests of the page, and passes the messages of the language server on. */
export class Connection {
  /** @param {TextTransport} transport */
  constructor(transport) {
    this.transport = transport;
    this.nextId = 1;
    /** @type {Map<string, {resolve: (result: any) => void, reject: (error: Error) => void}>} */
    this.pending = new Map();
    this.waitsSince = 0;
    /** @type {Map<string, Set<(params: any) => void>>} */
    this.listeners = new Map();
    /** @type {Set<(text: string) => void>} */
    this.languageHandlers = new Set();
    transport.onText = (text) => this.receive(text);
    transport.onClose = (reason) => this.close(reason);
  }

  /** @param {string} method @param {object} [params] @returns {Promise<any>} */
  request(method, params = {}) {
    const id = `p${this.nextId++}`; // the language client counts with numbers
    if (!this.pending.size) this.waitsSince = performance.now();
    return new Promise((resolve, reject) => {
      this.pending.set(id, { resolve, reject });
      this.transport.send(JSON.stringify({ jsonrpc: "2.0", id, method, params }));
    });
  }

  /** Return true if nothing was answered for a second, although there are requests. */
  get isWaiting() {
    return this.pending.size > 0 && performance.now() - this.waitsSince > 1000;
  }

  /** Stop what the server computes for the requests so far; they are answered by an error with the code `STOPPED`. */
  stop() {
    const stopped = [...this.pending.keys()];
    const send = () => {
      if (!stopped.some((id) => this.pending.has(id))) return;
      this.transport.send(JSON.stringify({ jsonrpc: "2.0", method: "page/stop" }));
      setTimeout(send, 300); // the next of them may have begun
    };
    send();
  }

  /** Call `callback` for each notification of a method; return a function that ends this.
   * @param {string} method @param {(params: any) => void} callback */
  on(method, callback) {
    const known = this.listeners.get(method) ?? new Set();
    this.listeners.set(method, known.add(callback));
    return () => known.delete(callback);
  }

  /** Return the transport as the language client of CodeMirror expects it. */
  languageTransport() {
    return {
      send: (/** @type {string} */ text) => this.transport.send(text),
      subscribe: (/** @type {(text: string) => void} */ handler) => void this.languageHandlers.add(handler),
      unsubscribe: (/** @type {(text: string) => void} */ handler) => void this.languageHandlers.delete(handler),
    };
  }

  /** @param {string} text */
  receive(text) {
    const message = JSON.parse(text);
    const waiting = this.pending.get(message.id);
    if (waiting && !message.method) {
      this.pending.delete(message.id);
      this.waitsSince = performance.now();
      if (message.error) waiting.reject(new RequestError(message.error));
      else waiting.resolve(message.result);
      return;
    }
    for (const callback of this.listeners.get(message.method) ?? []) callback(message.params);
    if (!message.method?.startsWith("page/")) for (const handler of this.languageHandlers) handler(text);
  }

  /** @param {string} [reason] */
  close(reason = "The connection was closed.") {
    for (const { reject } of this.pending.values()) reject(new Error(reason));
    this.pending.clear();
    for (const callback of this.listeners.get("closed") ?? []) callback({});
  }
}

/** @param {string} path @returns {Promise<TextTransport>} */
function openSocket(path) {
  const address = new URL(path, location.href);
  address.protocol = address.protocol.replace("http", "ws");
  const socket = new WebSocket(address);
  const transport = { send: (/** @type {string} */ text) => socket.send(text), onText: (/** @type {string} */ _) => {}, onClose: (/** @type {string|undefined} */ _ = undefined) => {} };
  socket.onmessage = (event) => transport.onText(event.data);
  return new Promise((resolve, reject) => {
    socket.onopen = () => {
      socket.onclose = () => transport.onClose();
      resolve(transport);
    };
    socket.onclose = () => reject(new Error("`envgraph serve` does not answer. Start it again, and open the address that it prints."));
  });
}

/** The worker gets the query of the page, which may name a domain. @param {string} script @returns {TextTransport} */
function openWorker(script) {
  const worker = new Worker(new URL(script + location.search, location.href), { type: "module" });
  const transport = { send: (/** @type {string} */ text) => worker.postMessage(text), onText: (/** @type {string} */ _) => {}, onClose: (/** @type {string|undefined} */ _ = undefined) => {} };
  worker.onmessage = (event) => transport.onText(event.data);
  worker.onerror = (event) => transport.onClose(event.message?.replace(/^Uncaught Error: /, "") || undefined);
  return transport;
}

/** The worker that answers in place of a server, if the page names one. */
export const workerScript = () => document.querySelector('meta[name="envgraph-worker"]')?.getAttribute("content") ?? "";

/** Connect to the worker that the page names, or else to the server that sent the page. */
export async function connect() {
  return new Connection(workerScript() ? openWorker(workerScript()) : await openSocket("socket"));
}
