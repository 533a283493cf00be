// What is chosen on the page: environment, ends, time, weights. It stands in the address, so that a link shows the same.

const HOUR_MS = 3.6e6;
const MOST_HOURS = 1e6;

export class Choice {
  constructor() {
    const told = new URLSearchParams(location.hash.slice(1));
    this.environment = name(told, "environment") ?? "";
    this.sensor = name(told, "sensor"); // null: not chosen yet
    this.start = name(told, "from") ?? "";
    this.goal = name(told, "to") ?? "";
    this.perMetre = told.get("per_metre") === "1";
    this.modes = {}; // weights by name, as the console tells them
    this.theta = weights(told.get("theta"));
    const at = told.has("at") ? Date.parse(`${told.get("at").replace(/Z$/, "")}Z`) / HOUR_MS : NaN;
    this.fixed = at >= 0 && at <= MOST_HOURS ? at : null; // hours since the epoch; null follows the clock
  }

  /** The time of the drive, hours since the epoch. */
  get at() { return this.fixed ?? Date.now() / HOUR_MS; }

  /** The mode with these weights, if there is one. */
  get mode() {
    return Object.keys(this.modes).find((name) => this.modes[name].every((weight, k) => Math.abs(weight - this.theta[k]) < 1e-9));
  }

  /** Takes a day, as 2026-06-21, or a time of day in minutes; the clock is followed no more. */
  set({ day, minutes }) {
    const before = this.at;
    const midnight = day ? Date.parse(`${day}T00:00Z`) / HOUR_MS : 24 * Math.floor(before / 24);
    const hour = minutes === undefined ? before % 24 : minutes / 60;
    const at = midnight + hour;
    if (at >= 0 && at <= MOST_HOURS) this.fixed = at;
  }

  /** Writes the choice into the address. */
  keep() {
    const told = new URLSearchParams({ environment: this.environment, from: this.start, to: this.goal, theta: this.theta.join(",") });
    if (this.sensor) told.set("sensor", this.sensor);
    if (this.perMetre) told.set("per_metre", "1");
    if (this.fixed !== null) told.set("at", new Date(this.fixed * HOUR_MS).toISOString().slice(0, 19));
    history.replaceState(null, "", `#${told}`);
  }

  /** The same as the arguments of `costs`. */
  asked() {
    return {
      environment: this.environment, sensor: this.sensor ?? "", at_hours: this.at, theta: this.theta,
      per_metre: this.perMetre, start: this.start, goal: this.goal,
    };
  }
}

/** A name in an address that somebody may have written by hand; null where it is none. */
function name(told, key) {
  const text = told.get(key) ?? "";
  return /^[a-zA-Z0-9][a-zA-Z0-9_:-]{0,99}$/.test(text) ? text : null;
}

function weights(text) {
  const found = (text ?? "").split(",").map(Number);
  const right = found.length === 3 && text && found.every((one) => Number.isFinite(one) && Math.abs(one) <= 10);
  return right ? found : null;
}
