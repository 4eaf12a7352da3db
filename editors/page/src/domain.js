// What the page knows about the open domain, and who wants to hear when that changes.

/**
 * @typedef {import("./types.js").Domain} DomainData
 * @typedef {import("./connection.js").Connection} Connection
 */

export class Domain extends EventTarget {
  /** @param {Connection} connection @param {DomainData} data */
  constructor(connection, data) {
    super();
    this.connection = connection;
    this.data = data;
    this.newest = { version: data.version, errors: data.errors };
    this.isAsking = false;
    connection.on("page/changed", (change) => this.update(change));
  }

  /** Ask again after the texts were checked. With errors, everything stays as in the last version without errors.
   * @param {{version: number, errors: number}} change */
  async update(change) {
    this.newest = change;
    if (this.isAsking) return;
    this.isAsking = true;
    try {
      while (!this.newest.errors && this.data.version < this.newest.version) this.data = await this.connection.request("page/open");
    } finally {
      this.isAsking = false;
    }
    this.data = { ...this.data, errors: this.newest.errors };
    this.dispatchEvent(new Event("changed"));
  }

  get members() {
    return this.data.members.map((member) => member.name);
  }
}
