// The fleet's page: asks for what is chosen, and draws what comes.

import { byId, make, say } from "/static/common/dom.js";
import { Choice } from "/static/fleet/choice.js";
import { Day } from "/static/fleet/day.js";
import { Graph } from "/static/fleet/graph.js";
import { Matrix } from "/static/fleet/matrix.js";
import { Spectrum } from "/static/fleet/spectrum.js";
import { costTable, planItems, rhythmTable, robotTable, sentence } from "/static/fleet/tables.js";

const AGAIN_MS = 10000; // the clock goes on, and the console learns that somebody looks

class FleetPage {
  constructor(link) {
    this.link = link;
    this.choice = new Choice();
    this.known = null; // the environment as it was told
    this.answer = null;
    this.curves = null;
    this.route = "";
    this.missing = null; // not told yet
    this.trouble = "";
    this.day = new Day(byId("day"), (hour) => this.#time(Math.round(hour * 12) * 5), (text) => say(byId("day-hint"), text));
    this.graph = new Graph(byId("graph"), (place, start) => this.#ends(start ? { start: place } : { goal: place }));
    this.matrix = new Matrix(byId("similarity"), (text) => say(byId("similarity-note"), text || this.matrixNote));
    this.spectrum = new Spectrum(byId("spectrum"));
    this.readCosts = latest(() => this.#readCosts());
    this.readEnvironment = latest(() => this.#readEnvironment());
    this.readSimilarity = latest(() => this.#readSimilarity());
    this.#wire();
    link.on("own", (own) => { this.own = own; });
    link.on("modes", (modes) => this.#modes(modes));
    link.on("fleet", (fleet) => this.#fleet(fleet));
    link.on("versions", (versions) => this.#versions(versions));
    link.on("robots", (robots) => { this.robots = robots; this.#robots(); });
    link.addEventListener("all", () => this.#all());
    setInterval(() => { if (this.choice.environment && !document.hidden) this.readCosts(); }, AGAIN_MS);
  }

  #wire() {
    const on = (id, event, act) => byId(id).addEventListener(event, act);
    on("environment", "change", () => this.#environment(byId("environment").value));
    on("sensor", "change", () => { this.choice.sensor = byId("sensor").value; this.readEnvironment(); });
    on("from", "change", () => this.#ends({ start: byId("from").value }));
    on("to", "change", () => this.#ends({ goal: byId("to").value }));
    on("swap", "click", () => this.#ends({ start: this.choice.goal, goal: this.choice.start }));
    on("date", "change", () => { this.choice.set({ day: byId("date").value }); this.#changed(); });
    on("hour", "input", () => this.#time(Number(byId("hour").value)));
    on("now", "click", () => { this.choice.fixed = this.choice.fixed === null ? this.choice.at : null; this.#changed(); });
    on("per-metre", "change", () => { this.choice.perMetre = byId("per-metre").checked; this.#changed(); });
    on("route", "change", () => { this.route = byId("route").value; this.readSimilarity(); });
    for (const button of document.querySelectorAll("[data-mode]")) {
      button.addEventListener("click", () => { this.choice.theta = this.choice.modes[button.dataset.mode]; this.#changed(); });
    }
    [0, 1, 2].forEach((k) => on(`theta-${k}`, "input", () => {
      this.choice.theta = [0, 1, 2].map((one) => (one === k ? Number(byId(`theta-${k}`).value) : this.choice.theta[one]));
      this.#changed();
    }));
  }

  #time(minutes) {
    this.choice.set({ minutes: Math.min(minutes, 1435) });
    this.#changed();
  }

  #ends(ends) {
    if (ends.goal !== undefined && ends.goal === this.choice.start && ends.start === undefined) ends.start = this.choice.goal;
    if (ends.start !== undefined && ends.start === this.choice.goal && ends.goal === undefined) ends.goal = this.choice.start;
    Object.assign(this.choice, ends);
    this.#changed();
  }

  #environment(name) {
    Object.assign(this.choice, { environment: name, start: "", goal: "", sensor: null });
    byId("environment").value = name;
    this.route = "";
    this.readEnvironment();
  }

  #changed() {
    this.#showChoice();
    this.choice.keep();
    this.readCosts();
  }

  /** Everything has been told anew: what was drawn may be of another console's life. */
  #all() {
    this.curves = null;
    if (this.choice.environment) this.readEnvironment();
  }

  #modes(modes) {
    this.choice.modes = modes ?? {};
    this.choice.theta ??= modes?.robust;
  }

  #fleet(fleet) {
    if (!fleet) return;
    const names = fleet.environments.map((one) => one.name);
    this.missing = fleet.missing || (names.length ? "" : "no robot has shared a map yet: a taught map appears here once its ends are named");
    this.#tell();
    const bare = !names.length && !fleet.missing; // the robots are there before their maps
    byId("fleet").classList.toggle("bare", bare);
    byId("fleet").hidden = !bare && (!names.length || !this.known);
    options(byId("environment"), fleet.environments.map((one) => [one.name, `${one.name} (${count(one.maps, "map")})`]), this.choice.environment);
    const own = fleet.environments.find((one) => one.name === this.choice.environment);
    byId("pending").hidden = !own?.pending;
    say(byId("pending"), own?.pending ? `${own.pending} to compare` : "");
    if (!names.length || names.includes(this.choice.environment)) return;
    this.#environment(names.includes(this.own?.environment) ? this.own.environment : names[0]);
  }

  #versions(versions) {
    const version = versions?.[this.choice.environment];
    if (version !== undefined && version !== this.version) this.readEnvironment();
    this.version = version;
  }

  async #readEnvironment() {
    const { environment } = this.choice;
    const sensor = this.choice.sensor ?? "";
    const known = await this.#do("environment", { environment, sensor });
    if (!known || environment !== this.choice.environment) return;
    if (this.choice.sensor === null || (sensor && !known.sensors.includes(sensor))) {
      this.choice.sensor = known.sensors.includes(this.own?.sensor) && known.sensors.length > 1 ? this.own.sensor : "";
      if (this.choice.sensor !== sensor) { this.readEnvironment(); return; }
    }
    this.known = known;
    this.#tell();
    byId("fleet").hidden = false;
    this.#showEnvironment(known);
    this.readSimilarity();
    this.#changed();
  }

  async #readCosts() {
    const asked = this.choice.asked();
    const answer = await this.#do("costs", { ...asked, curves: this.curves ? this.curves.key : "" });
    if (!answer || asked.environment !== this.choice.environment) return;
    this.answer = answer;
    if (answer.drawn) {
      this.curves = { ...answer.drawn, key: answer.curves };
      this.day.show(this.curves);
    }
    this.#showAnswer(answer);
  }

  async #readSimilarity() {
    const [start, end] = this.route.split(" ");
    try {
      if (!end) throw new Error("no route has two maps to compare");
      const found = await this.link.do("similarity", { environment: this.choice.environment, start, end });
      this.matrixNote = `${count(found.maps.length, "map")} by time, from ${found.maps[0]} to ${found.maps.at(-1)}`;
      this.matrix.show(found);
    } catch (error) {
      this.matrixNote = error.message;
      this.matrix.show(null);
    }
    say(byId("similarity-note"), this.matrixNote);
  }

  /** What the console tells, or null where it cannot now; then the page says so until it can. */
  async #do(action, args) {
    let told = null;
    try {
      told = await this.link.do(action, args);
      this.trouble = "";
    } catch (error) {
      this.trouble = error.message;
    }
    this.#tell();
    return told;
  }

  /** Says what is wrong, if anything is. */
  #tell() {
    const reading = this.known === null && this.missing === "" ? "the environment is being read" : "";
    const text = this.missing || this.trouble || reading;
    say(byId("missing"), text ? sentence(text, []) : "");
    byId("missing").hidden = !text;
  }

  #showEnvironment(known) {
    const places = known.places.map((place) => [place.name, place.label]).sort((a, b) => a[1].localeCompare(b[1], undefined, { numeric: true }));
    const has = (place) => known.places.some((one) => one.name === place);
    if (!has(this.choice.start) && !has(this.choice.goal)) [this.choice.start, this.choice.goal] = known.ends;
    options(byId("from"), places, this.choice.start);
    options(byId("to"), places, this.choice.goal);
    byId("sensor-box").hidden = known.sensors.length < 2;
    options(byId("sensor"), [["", "every sensor"], ...known.sensors.map((name) => [name, name])], this.choice.sensor);
    const compared = known.routes.filter((route) => route.maps > 1);
    const labels = new Map(known.places.map((place) => [place.name, place.label]));
    const routes = compared.map((route) => (
      [`${route.start} ${route.end}`, `${labels.get(route.start)} → ${labels.get(route.end)} (${route.maps})`]));
    if (!routes.some(([value]) => value === this.route)) this.route = routes[0]?.[0] ?? "";
    options(byId("route"), routes, this.route);
    byId("route").hidden = !routes.length;
    const drawn = known.places.filter((place) => place.at).length;
    byId("graph-note").hidden = drawn === known.places.length;
    say(byId("graph-note"), `${drawn} of ${known.places.length} places are drawn, those with most maps`);
    this.spectrum.show(known.spectrum, known.model.rhythms);
    byId("rhythms").replaceChildren(...rhythmTable(known.model.rhythms));
    say(byId("spectrum-of"), known.model.maps ? `of ${count(known.model.maps, "map")}` : "");
    const trend = known.model.trend ? ` For good, likeness falls by ${known.model.trend.toPrecision(2)} per hour.` : "";
    say(byId("spectrum-why"), `${sentence(known.model.reason || "no reason is given", [])}${trend}`);
    this.#robots();
  }

  #robots() {
    byId("robots").replaceChildren(...robotTable(this.robots ?? {}, this.known?.robots ?? {}, this.own?.robots ?? "*"));
  }

  #showChoice() {
    const { choice } = this;
    const minutes = Math.floor((choice.at % 24) * 60 + 1e-6);
    byId("from").value = choice.start;
    byId("to").value = choice.goal;
    byId("hour").value = minutes;
    byId("date").value = new Date(choice.at * 3.6e6).toISOString().slice(0, 10);
    const clock = `${String(Math.floor(minutes / 60)).padStart(2, "0")}:${String(minutes % 60).padStart(2, "0")}`;
    say(byId("clock"), clock);
    byId("hour").setAttribute("aria-valuetext", clock);
    byId("now").setAttribute("aria-pressed", String(choice.fixed === null));
    byId("per-metre").checked = choice.perMetre;
    for (const button of document.querySelectorAll("[data-mode]")) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === choice.mode));
    }
    choice.theta.forEach((weight, k) => {
      byId(`theta-${k}`).value = weight;
      say(document.querySelector(`output[for="theta-${k}"]`), weight.toFixed(2));
    });
  }

  #showAnswer(answer) {
    const order = new Map((answer.plan?.maps ?? []).map((map, k) => [map, k]));
    const at = answer.at % 24;
    this.#showChoice();
    this.day.mark(at, answer.rows, order);
    this.graph.show(this.known?.places ?? [], this.known?.routes ?? [], answer.rows, order, [this.choice.start, this.choice.goal]);
    byId("no-plan").hidden = !answer.reason;
    say(byId("no-plan"), answer.reason && sentence(answer.reason, answer.rows));
    byId("plan").replaceChildren(...(answer.plan ? planItems(answer.plan, answer.rows) : []));
    say(byId("plan-sum"), answer.plan ? `cost ${answer.plan.cost.toFixed(3)} · ${answer.plan.length.toFixed(1)} m` : "");
    say(byId("plan-whole"), answer.plan ? sentence(answer.plan.why.at(-1), answer.rows) : "");
    byId("plan-sought").hidden = !answer.plan || this.choice.theta.every((weight) => weight >= 0);
    byId("costs").replaceChildren(...costTable(answer.rows, order));
    const more = answer.total - answer.rows.length;
    say(byId("costs-note"), more > 0 ? `the ${answer.rows.length} cheapest of ${answer.total} maps` : count(answer.total, "map"));
  }
}

/** Lets one call be on its way at a time, and the last wish be the last that is carried out. */
function latest(work) {
  let busy = false;
  let again = false;
  return async function run() {
    if (busy) { again = true; return; }
    busy = true;
    try {
      await work();
    } finally {
      busy = false;
    }
    if (again) { again = false; run(); }
  };
}

/** Fills a list of choices where it differs, and keeps what is chosen. */
function options(select, entries, chosen) {
  const text = JSON.stringify(entries);
  if (select.dataset.entries !== text) {
    select.dataset.entries = text;
    select.replaceChildren(...entries.map(([value, label]) => make("option", { value }, label)));
  }
  select.value = chosen ?? "";
}

function count(number, what) {
  return `${number} ${what}${number === 1 ? "" : "s"}`;
}

export function start(link) {
  return new FleetPage(link);
}
