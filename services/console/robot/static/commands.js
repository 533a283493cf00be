// The buttons of an operator's commands: each acts, or says why it cannot.

import { able, byId, say } from "/static/common/dom.js";

const PLACE = "[a-z0-9][a-z0-9_-]{0,62}";
const PLACE_HINT = "a-z, 0-9, - and _";

export function startCommands(link, frame) {
  let refused = {};
  const buttons = new Map(); // button → command

  const commands = {
    /** Has a button do a command, or say why that cannot be done now. */
    bind(button, command, act) {
      buttons.set(button, command);
      able(button, refused[command]);
      button.addEventListener("click", () => {
        if (refused[command]) frame.toast(`Not now: ${refused[command]}.`, true);
        else act();
      });
      const tell = () => say(byId("why"), refused[command] ? `Not now: ${refused[command]}.` : "");
      button.addEventListener("pointerenter", tell);
      button.addEventListener("focus", tell);
      button.addEventListener("pointerleave", () => say(byId("why"), ""));
      button.addEventListener("blur", () => say(byId("why"), ""));
    },
    /** Forgets buttons that are shown no more. */
    release(gone) { for (const button of gone) buttons.delete(button); },
    why(command) { return refused[command] ?? "the console is out of reach"; },
  };

  const show = () => { for (const [button, command] of buttons) able(button, refused[command]); };
  link.on("refused", (value) => { refused = value ?? {}; show(); });
  link.addEventListener("lost", () => {
    refused = Object.fromEntries(Object.keys(refused).map((name) => [name, "the console is out of reach"]));
    show();
  });

  const simple = (command, args = {}) => commands.bind(byId(`do-${command}`), command, () => frame.act(command, args));
  ["branch", "resume", "cancel", "reject"].forEach((command) => simple(command));
  simple("pause");
  simple("merge");
  commands.bind(byId("do-pause_ahead"), "pause_ahead", () => frame.act("pause", { at_vertex: true }));
  commands.bind(byId("do-find"), "find", () => frame.act("position", { find: true }));
  commands.bind(byId("do-teach"), "teach", () => teach(frame));
  commands.bind(byId("do-finish"), "finish", async () => {
    const ends = await frame.ask("Finish this map", [place("end_place", "Name of the place where it ends")], "Finish",
      "Its last vertex gets the name. Without one the map can still be driven to by a click.");
    if (ends) frame.act("finish", ends);
  });
  commands.bind(byId("do-confirm"), "confirm", async () => {
    const ends = await frame.ask("Join the two maps here?", [place("end_place", "Name of the place, if it is new")],
      "Join and finish", "The map ends here, and plans will lead over this joint. It cannot be undone.");
    if (ends) frame.act("confirm", ends);
  });
  return commands;
}

export function place(name, label, value = "") {
  return { name, label, value, pattern: PLACE, hint: PLACE_HINT, placeholder: PLACE_HINT };
}

/** Asks where a map begins, and has it taught, from a vertex if one is given. */
export async function teach(frame, vertex = "") {
  const about = vertex
    ? "The robot localizes against this vertex first; then drive it, and it learns the way."
    : "Drive the robot by hand, and it learns the way. Where it knows its place, the new map branches off there.";
  const start = await frame.ask("Teach a map", [place("start_place", "Name of the place where it starts")], "Teach", about);
  if (start) frame.act("teach", { ...start, vertex });
}
