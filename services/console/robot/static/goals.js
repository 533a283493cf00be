// The goal that is driven to, those that wait, and the field for another one.

import { brief, byId, make, say } from "/static/common/dom.js";
import { shortName } from "./graph.js";

export function startGoals(link, frame, commands, graph) {
  let shown = "";
  const draw = () => {
    const state = link.values.get("state") ?? {};
    const text = JSON.stringify([state.goal, state.goals]);
    if (text !== shown) {
      shown = text;
      show(state, frame, commands);
    }
  };
  link.on("state", draw);
  link.on("live", (live) => say(byId("goal-left"), live?.remaining === undefined ? "" : `${live.remaining.toFixed(1)} m left`));
  graph.addEventListener("changed", () => offer(graph));

  const wanted = () => ({ to: byId("goal").value.trim(), mode: byId("goal-mode").value || null });
  const send = async (action) => {
    if (!wanted().to) {
      frame.toast("Say where to: a place, a map, or a vertex as map:index. Or click it on the map.", true);
      return byId("goal").focus();
    }
    if (await frame.act(action, { goal: wanted() })) byId("goal").value = "";
    return undefined;
  };
  commands.bind(byId("do-repeat"), "repeat", () => send("repeat"));
  commands.bind(byId("do-append"), "append", () => send("append"));
  byId("goal-form").addEventListener("submit", (event) => {
    event.preventDefault();
    byId(commands.why("append") === "" ? "do-append" : "do-repeat").click();
  });
}

function show(state, frame, commands) {
  const list = byId("goals");
  commands.release(list.querySelectorAll("button"));
  const rows = (state.goals ?? []).map((goal, index) => waiting(goal, index, state.goals.length, frame, commands));
  if (state.goal) rows.unshift(make("li", { class: "goal now" }, make("b", {}, "→"), make("span", { class: "grow", title: state.goal }, brief(state.goal))));
  if (rows.length === 0) rows.push(make("li", { class: "soft" }, "None. Click a vertex or a place on the map, or name one here."));
  list.replaceChildren(...rows);
}

function waiting(goal, index, count, frame, commands) {
  const number = index + 1;
  const button = (text, label, command, args, possible) => {
    const made = make("button", { class: "icon quiet", type: "button", "aria-label": label, title: label, disabled: !possible }, text);
    commands.bind(made, command, () => frame.act(command, args));
    return made;
  };
  return make("li", { class: "goal" },
    make("span", { class: "soft figure" }, `${number}`),
    make("span", { class: "grow", title: goal.to }, brief(goal.to), goal.mode ? make("span", { class: "soft small" }, ` ${goal.mode}`) : null),
    button("↑", `${goal.to} sooner`, "move", { number, to: number - 1 }, index > 0),
    button("↓", `${goal.to} later`, "move", { number, to: number + 1 }, index < count - 1),
    button("✕", `${goal.to} no more`, "drop", { number }, true));
}

let offered = "";
function offer(graph) {
  const maps = [...graph.maps].filter(([, map]) => map.about.generation === 0 && map.about.finished);
  const values = [...Object.keys(graph.places).map((name) => [name, "place"]),
    ...maps.map(([id, map]) => [id, shortName(id, map.about)])];
  const text = JSON.stringify(values);
  if (text === offered) return;
  offered = text;
  byId("goal-places").replaceChildren(...values.map(([value, label]) => make("option", { value, label })));
}
