// The state, why, and what it waits for; the figures of this moment; safety's reasons.

import { brief, byId, fixed, make, say } from "/static/common/dom.js";
import { duration } from "./clock.js";

const KIND = { Idle: "", Teach: "good", Repeat: "good", Paused: "warn" };

export function startStatus(link, frame, clock) {
  link.on("state", (state) => showState(state));
  link.on("live", (live) => showFigures(live ?? {}));
  link.on("safety", (safety) => showSafety(safety, frame));
  for (const key of ["state", "safety"]) link.on(key, () => showHeld(link.values.get("state"), link.values.get("safety")));
  link.on("robot", (robot) => { if (robot) document.title = `${robot.name} · Robot`; });
  setInterval(() => showSince(link.values.get("state")), 1000);
  setInterval(() => {
    const live = link.values.get("live");
    const now = clock.now();
    if (live && now !== null) byId("link").title = `${Math.round((now - live.t) * 1000)} ms behind`;
  }, 1000);
}

function showState(state) {
  const name = byId("state-name");
  if (!state) return say(name, "—");
  const [whole, part] = state.name.split(".");
  const words = part ? `${whole} · ${spaced(part)}` : whole;
  say(name, state.resumes ? `${words} (${spaced(state.resumes.replace(".", " · "))})` : words);
  name.className = `state-name ${KIND[whole] ?? ""}`;
  say(byId("state-reason"), sentence(brief(state.reason)));
  byId("state-waiting").hidden = !state.waiting;
  say(byId("state-waiting"), state.waiting ? `Waits for ${brief(state.waiting)}.` : "");
  byId("closure").hidden = !state.closure;
  if (state.closure) {
    say(byId("closure-text"), `Does the map meet ${brief(state.closure.to)} here? ${state.closure.inliers} landmarks agree.`);
  }
  showSince(state);
  return undefined;
}

function showSince(state) {
  if (state) say(byId("state-since"), `for ${duration(Math.max((Date.now() - state.since) / 1000, 0))}`);
}

/** Why the robot stands though its state would have it move. */
function showHeld(state, safety) {
  const drives = /^(Teach\.|Repeat\.Follow)/.test(state?.name ?? "");
  const reason = safety?.reasons.find((one) => one.rule !== "command_stale");
  const text = safety?.latched ? "The emergency stop is latched: release it, then resume."
    : drives && safety && !safety.passing && reason ? reason.text : "";
  byId("state-held").hidden = !text;
  say(byId("state-held"), text);
}

function showFigures(live) {
  const rows = [
    ["Speed", has(live.v, (v) => `${fixed(v, 2)} m/s`)],
    ["Beside the path", has(live.lateral, (v) => `${fixed(100 * v, 0)} cm`)],
    ["Inliers", has(live.inliers, String)],
    ["Since localized", has(live.metres, (v) => `${v.toFixed(1)} m`)],
    ["Position by", live.by || "—"],
    ["Limit", has(live.limit, (v) => `${v.toFixed(1)} m/s`)],
  ];
  const list = byId("figures");
  if (list.children.length === 0) {
    list.append(...rows.map(([name]) => make("div", {}, make("dt", {}, name), make("dd", { class: "figure" }))));
  }
  rows.forEach(([, value], index) => say(list.children[index].lastChild, value));
}

function showSafety(safety, frame) {
  const pill = byId("safety-state");
  frame.latched(Boolean(safety?.latched));
  if (!safety) {
    say(pill, "unknown");
    pill.className = "pill warn";
    byId("safety").replaceChildren();
    return;
  }
  const slow = safety.passing && safety.scale < 1;
  say(pill, safety.latched ? "emergency stop" : safety.passing ? (slow ? `slowed to ${Math.round(100 * safety.scale)} %` : "passes") : "holds");
  pill.className = `pill ${safety.latched ? "bad" : safety.passing && !slow ? "good" : "warn"}`;
  const list = byId("safety");
  while (list.children.length > safety.reasons.length) list.lastChild.remove();
  while (list.children.length < safety.reasons.length) list.append(make("li"));
  safety.reasons.forEach((reason, index) => {
    say(list.children[index], reason.text);
    list.children[index].title = reason.rule;
  });
  list.classList.toggle("none", safety.reasons.length === 0);
}

const has = (value, text) => (value === undefined || value === null ? "—" : text(value));
const spaced = (name) => name.replace(/([a-z])([A-Z])/g, "$1 $2");
const sentence = (text) => (text ? text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".") : "");
