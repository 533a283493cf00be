// The plan as a list; costs, rhythms and robots as tables.

import { make } from "/static/common/dom.js";

/** The plan's maps in order, and why each was chosen; `rows` are those of all listed maps. */
export function planItems(plan, rows) {
  const byMap = new Map(rows.map((row) => [row.map, row]));
  return plan.maps.map((map, k) => {
    const row = byMap.get(map);
    const said = plan.why[k].replace(`${map} from ${row.start} to ${row.end}, `, "");
    return make("li", { class: `stage-${k % 8}` },
      make("span", { class: "number", "aria-hidden": "true" }, String(k + 1)),
      make("span", { class: "what", title: map }, `${row.from} → ${row.to}`, make("span", { class: "soft" }, `  ${row.name}`)),
      make("span", { class: "figure", title: "what a plan adds up" }, row.edge.toFixed(3)),
      make("span", { class: "why soft small" }, sentence(said, rows)));
  });
}

/** A sentence with the short names of maps in place of their ids, beginning as sentences do. */
export function sentence(text, rows) {
  let short = text;
  for (const row of rows) if (row.name !== row.map) short = short.split(row.map).join(row.name);
  return `${short[0].toUpperCase()}${short.slice(1)}${/[.!?]$/.test(short) ? "" : "."}`;
}

/** Every listed map and its costs, cheapest first. */
export function costTable(rows, order) {
  const trouble = rows.some((row) => "trouble" in row);
  const terms = ["cost", "similarity", "distance", "drift", ...(trouble ? ["trouble"] : [])];
  const heads = { similarity: "likeness", distance: "distance", drift: "drift", trouble: "trouble", cost: "cost J" };
  const sorted = [...rows].sort((a, b) => a.cost - b.cost);
  return [
    make("thead", {}, make("tr", {}, ...["map", "from", "to"].map((text) => make("th", { scope: "col" }, text)),
      ...[...terms.map((term) => heads[term]), "m", "gen."].map((text) => make("th", { class: "number", scope: "col" }, text)))),
    make("tbody", {}, ...sorted.map((row) => {
      const number = order.get(row.map);
      return make("tr", { class: number === undefined ? null : `chosen stage-${number % 8}`, "data-map": row.map },
        make("td", { title: row.map }, row.name), make("td", {}, row.from), make("td", {}, row.to),
        ...terms.map((term) => make("td", { class: term === "cost" ? "number total" : "number" }, row[term].toFixed(3))),
        make("td", { class: "number" }, row.length.toFixed(1)), make("td", { class: "number" }, String(row.generation)));
    })),
  ];
}

/** The rhythms of a model. */
export function rhythmTable(rhythms) {
  if (!rhythms.length) return [];
  const heads = ["period", "weight", "phase", "by chance"];
  return [
    make("thead", {}, make("tr", {}, ...heads.map((text, k) => make("th", { class: k ? "number" : null, scope: "col" }, text)))),
    make("tbody", {}, ...rhythms.map((one) => make("tr", {}, make("td", {}, one.period),
      make("td", { class: "number" }, one.weight.toFixed(3)), make("td", { class: "number" }, `${(Math.round(100 * one.phase) / 100 || 0).toFixed(2)} rad`),
      make("td", { class: "number" }, one.significance < 1e-12 ? "< 1e-12" : one.significance.toPrecision(2))))),
  ];
}

/** Robots that are connected or have shared maps; `seen` is the one whose presence can be seen from here, "*" for all. */
export function robotTable(connected, shared, seen) {
  const names = [...new Set([...Object.keys(connected), ...Object.keys(shared)])].filter(Boolean).sort();
  if (!names.length) return [make("tbody", {}, make("tr", {}, make("td", { class: "soft" }, "no robot is connected, and none has shared a map")))];
  const heads = ["robot", "", "does", "maps", "m", "newest map"];
  const numbers = new Set(["maps", "m"]);
  const small = new Set(["does", "newest map"]);
  return [
    make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { class: numbers.has(text) ? "number" : small.has(text) ? "aside" : null, scope: "col" }, text)))),
    make("tbody", {}, ...names.map((name) => robotRow(name, connected[name], shared[name], seen === "*" || seen === name))),
  ];
}

function robotRow(name, here, maps, seen) {
  const pill = here ? make("span", { class: "pill good", title: `${here.processes} processes` }, "connected")
    : seen ? make("span", { class: "pill" }, "away")
      : make("span", { class: "soft small", title: "a robot may not look at others; the fleet server's page shows them" }, "not seen from here");
  const doing = here?.state ? `${here.state}: ${here.reason}${here.waiting_for ? `; waits for ${here.waiting_for}` : ""}` : "";
  return make("tr", { "data-robot": name }, make("td", {}, make("b", {}, name)), make("td", {}, pill), make("td", { class: "doing small" }, doing),
    make("td", { class: "number" }, maps ? String(maps.maps) : "0"), make("td", { class: "number" }, maps ? maps.metres.toFixed(0) : "0"),
    make("td", { class: "small" }, maps ? stamp(maps.last_hours) : ""));
}

/** A time as 2026-06-21 11:00. */
export function stamp(hours) {
  return new Date(hours * 3.6e6).toISOString().slice(0, 16).replace("T", " ");
}
