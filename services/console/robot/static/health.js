// Each process: whether it is there, when it was last heard, and what it takes.

import { byId, make, say } from "/static/common/dom.js";
import { duration } from "./clock.js";

const SILENT_S = 3;

export function startHealth(link, clock) {
  const rows = new Map();
  const draw = () => {
    const now = clock.now();
    let trouble = 0;
    for (const { row, about } of rows.values()) trouble += show(row, about, now) ? 0 : 1;
    const pill = byId("health-facts");
    say(pill, rows.size === 0 ? "unknown" : trouble ? `${trouble} not well` : "all there");
    pill.className = `pill ${rows.size === 0 ? "" : trouble ? "bad" : "good"}`;
  };
  link.on("process/*", (about, key) => {
    const name = key.slice(8);
    if (about === undefined) {
      rows.get(name)?.row.remove();
      rows.delete(name);
    } else if (rows.has(name)) {
      rows.get(name).about = about;
    } else {
      const row = make("tr", {}, make("td"), make("td", { class: "number figure" }), make("td", { class: "number figure" }),
        make("td", { class: "number figure wide" }), make("td", { class: "number figure wide" }));
      row.cells[0].append(make("span", { class: "lamp" }), make("span", {}, name));
      byId("health").append(row);
      rows.set(name, { row, about });
    }
    draw();
  });
  setInterval(draw, 500);
}

/** Whether a process is well. */
function show(row, about, now) {
  const age = about.heard === null || now === null ? null : Math.max(now - about.heard, 0);
  const silent = about.present && age !== null && age > SILENT_S;
  const well = about.present && !silent;
  row.cells[0].firstChild.className = `lamp ${well ? "good" : silent ? "warn" : "bad"}`;
  say(row.cells[1], !about.present ? "gone" : age === null ? "—" : duration(age));
  row.cells[1].className = `number figure ${well ? "" : "bad"}`;
  const here = about.present && about.pid !== undefined;
  say(row.cells[2], here ? `${Math.round(100 * about.cpu)} %` : "—");
  say(row.cells[3], here ? `${about.memory} MB` : "—");
  say(row.cells[4], here ? duration(Math.max((Date.now() - about.started) / 1000, 0)) : "—");
  row.title = here ? details(about) : "";
  return well;
}

function details(about) {
  const rates = Object.entries(about.rates).map(([key, rate]) => `${key} ${rate} Hz`);
  const stages = Object.entries(about.stages).map(([key, [p50, p99]]) => `${key} ${p50} ms (99 %: ${p99} ms)`);
  return [`pid ${about.pid}`, ...rates, ...stages, `${about.dropped} dropped`].join("\n");
}
