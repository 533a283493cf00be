// The joystick: it drives while it is held, and at no other time.

import { byId, fixed, say } from "/static/common/dom.js";

const PERIOD_MS = 50;
const KEYS = {
  ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1],
  w: [1, 0], s: [-1, 0], a: [0, 1], d: [0, -1],
};

export function startTeleop(link, frame) {
  const pad = byId("pad");
  const knob = byId("knob");
  const keys = new Set();
  let held = false;
  let stick = [0, 0]; // forwards, left
  let timer = null;
  let why = "the console is out of reach";

  const send = () => link.say({ drive: [...stick, performance.now() / 1000] });
  const show = () => {
    const radius = pad.clientWidth / 2 - knob.offsetWidth / 2;
    knob.style.transform = `translate(${-stick[1] * radius}px, ${-stick[0] * radius}px)`;
    pad.classList.toggle("held", held);
    const robot = link.values.get("robot") ?? { speed: 0, turn_rate: 0 };
    say(byId("teleop-v"), fixed(stick[0] * robot.speed, 2));
    say(byId("teleop-w"), fixed(stick[1] * robot.turn_rate, 2));
    say(byId("teleop-state"), held ? "driving" : why ? "not now" : "ready");
    byId("teleop-state").className = `pill ${held ? "warn" : why ? "" : "good"}`;
  };
  const hold = () => {
    if (held) return true;
    if (why) {
      frame.toast(`Not now: ${why}.`, true);
      return false;
    }
    held = true;
    send();
    timer = setInterval(send, PERIOD_MS);
    return true;
  };
  const release = () => {
    if (!held) return;
    held = false;
    clearInterval(timer);
    keys.clear();
    stick = [0, 0];
    link.say({ release: true });
    show();
  };

  pad.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    pad.focus();
    if (!hold()) return;
    pad.setPointerCapture(event.pointerId);
    stick = position(pad, event);
    show();
  });
  pad.addEventListener("pointermove", (event) => {
    if (!held || !pad.hasPointerCapture(event.pointerId)) return;
    stick = position(pad, event);
    show();
  });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) pad.addEventListener(name, release);
  window.addEventListener("blur", release);
  window.addEventListener("pagehide", release);
  document.addEventListener("visibilitychange", () => { if (document.hidden) release(); });
  link.addEventListener("lost", release);

  pad.addEventListener("keydown", (event) => {
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!(key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    if (event.repeat || !hold()) return;
    keys.add(key);
    stick = sum(keys);
    show();
  });
  pad.addEventListener("keyup", (event) => {
    keys.delete(event.key.length === 1 ? event.key.toLowerCase() : event.key);
    if (!held) return;
    if (keys.size === 0) release();
    else stick = sum(keys);
    show();
  });

  const judge = () => {
    const refused = link.values.get("refused");
    const driver = link.values.get("driver");
    const other = driver && driver !== link.you ? "another page drives" : "";
    why = link.open ? (refused?.teleop ?? "the robot's state is unknown") || other : "the console is out of reach";
    if (why) release();
    say(byId("teleop-why"), why ? `Not now: ${why}.` : "");
    pad.classList.toggle("off", Boolean(why));
    show();
  };
  link.on("refused", judge);
  link.on("driver", judge);
  link.addEventListener("lost", judge);
  judge();
}

/** [forwards, left] of a pointer on the pad, each in [-1, 1]. */
function position(pad, event) {
  const box = pad.getBoundingClientRect();
  const x = (event.clientX - box.left) / box.width * 2 - 1;
  const y = (event.clientY - box.top) / box.height * 2 - 1;
  const length = Math.max(Math.hypot(x, y), 1);
  return [-y / length, -x / length];
}

function sum(keys) {
  const total = [...keys].reduce(([f, l], key) => [f + KEYS[key][0], l + KEYS[key][1]], [0, 0]);
  return total.map((value) => Math.max(-1, Math.min(1, value)) * 0.7);
}
