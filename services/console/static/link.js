// A page's connection to the console: what it shows comes in, wishes go out; it comes back by itself.

const SILENT_MS = 3000; // the console speaks at least once a second
const RETRY_MS = 500;

export class Link extends EventTarget {
  constructor(page) {
    super();
    this.page = page;
    this.values = new Map();
    this.open = false;
    this.you = null; // the number that the console knows this page by
    this.listeners = [];
    this.streams = new Map();
    this.missed = new Map(); // what came of a series before anybody listened
    this.pictures = new Map();
    this.waiting = new Map();
    this.number = 0;
    document.addEventListener("visibilitychange", () => this.say({ visible: !document.hidden }));
    setInterval(() => this.#watch(), 500);
    this.#connect();
  }

  /** Calls back with (value, key) at each change of a section, or of all whose name begins with `prefix*`. */
  on(key, listener) {
    const prefix = key.endsWith("*") ? key.slice(0, -1) : null;
    this.listeners.push({ key, prefix, listener });
    for (const [name, value] of this.values) if (matches(name, key, prefix)) listener(value, name);
  }

  /** Calls back with (values, fresh): what came, and whether it is all that there is. */
  stream(key, listener) {
    this.streams.set(key, listener);
    const missed = this.missed.get(key);
    this.missed.delete(key);
    if (missed) listener(missed, true);
  }

  /** Calls back with (header, jpeg blob). */
  picture(name, listener) { this.pictures.set(name, listener); }

  /** Asks the page's service to do something; the promise fails with the sentence that says why not. */
  do(action, args = {}) {
    if (!this.open) return Promise.reject(new Error("the console is out of reach"));
    const id = ++this.number;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ id, do: action, with: args }));
    });
  }

  /** Sends what wants no answer; false where it cannot be sent now. */
  say(message) {
    if (!this.open) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  #connect() {
    const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/ws/${this.page}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard = performance.now();
    socket.onopen = () => { this.open = true; this.say({ visible: !document.hidden }); };
    socket.onmessage = (event) => { if (socket === this.socket) this.#take(event.data); };
    socket.onclose = () => { if (socket === this.socket) this.#lost(); };
  }

  #lost() {
    const was = this.open;
    this.open = false;
    this.socket = null;
    for (const { reject } of this.waiting.values()) reject(new Error("the console went away before it answered"));
    this.waiting.clear();
    this.dispatchEvent(new Event("lost"));
    if (!was) this.#checkLogin();
    setTimeout(() => this.#connect(), RETRY_MS);
  }

  /** A session that has ended looks like a console that has gone. */
  async #checkLogin() {
    try {
      const answer = await fetch(`/static/${this.page}/page.css`, { cache: "no-store" });
      if (answer.status === 401) location.href = "/login";
    } catch { /* out of reach: the next attempt tells */ }
  }

  #watch() {
    if (this.open && !document.hidden && performance.now() - this.heard > SILENT_MS) {
      const dead = this.socket;
      this.#lost();
      dead.close();
    }
  }

  #take(data) {
    this.heard = performance.now();
    if (typeof data !== "string") return this.#show(data);
    const told = JSON.parse(data);
    if ("re" in told) {
      const { resolve, reject } = this.waiting.get(told.re) ?? {};
      this.waiting.delete(told.re);
      if (told.ok) resolve?.(told.told);
      else reject?.(new Error(told.told));
      return undefined;
    }
    if ("you" in told) {
      this.you = told.you;
      return undefined;
    }
    if (told.all) {
      for (const key of this.values.keys()) if (!(key in (told.set ?? {}))) this.#set(key, undefined);
    }
    for (const [key, value] of Object.entries(told.set ?? {})) this.#set(key, value);
    for (const key of told.drop ?? []) this.#set(key, undefined);
    for (const [key, values] of Object.entries(told.add ?? {})) this.#add(key, values, Boolean(told.all));
    this.dispatchEvent(new Event(told.all ? "all" : "changed"));
    return undefined;
  }

  #add(key, values, fresh) {
    const listener = this.streams.get(key);
    if (listener) listener(values, fresh);
    else this.missed.set(key, fresh ? values : [...(this.missed.get(key) ?? []), ...values]);
  }

  #set(key, value) {
    if (value === undefined) this.values.delete(key);
    else this.values.set(key, value);
    for (const one of this.listeners) if (matches(key, one.key, one.prefix)) one.listener(value, key);
  }

  #show(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    this.pictures.get(header.name)?.(header, new Blob([new Uint8Array(buffer, 4 + length)], { type: "image/jpeg" }));
  }
}

function matches(name, key, prefix) {
  return prefix === null ? name === key : name.startsWith(prefix);
}
