// The map: what it shows, and what is done on it.

import { byId, make, say } from "/static/common/dom.js";
import { Background } from "./background.js";
import { listen } from "./input.js";
import * as layers from "./layers.js";
import { Menu } from "./menu.js";
import { Stretch } from "./stretch.js";
import { View } from "./view.js";

const PICK_PIXELS = 22;
const TURN = Math.PI / 24;

export function startMap(link, frame, commands, graph) {
  const canvas = byId("map");
  const view = new View(canvas);
  const cache = new Map();
  let [fitted, following, dirty, hovered] = [false, false, true, null];

  const redraw = () => { dirty = true; };
  const background = new Background(link, frame, redraw);
  const stretch = new Stretch(link, frame, commands, redraw);
  const menu = new Menu(link, frame, commands, graph, stretch);

  const fit = () => {
    view.fit(graph.bounds());
    redraw();
  };
  const follow = (is) => {
    following = is;
    byId("map-follow").setAttribute("aria-pressed", String(is));
    redraw();
  };
  const zoom = (factor, x = view.width / 2, y = view.height / 2, turn = 0) => {
    if (background.moving && background.shown) background.zoom(factor, turn);
    else view.zoom(factor, x, y, turn);
    redraw();
  };
  const pan = (dx, dy) => {
    if (background.moving && background.shown) {
      const [from, to] = [view.toMetre(0, 0), view.toMetre(dx, dy)];
      background.pan(to[0] - from[0], to[1] - from[1]);
    } else {
      follow(false);
      view.pan(dx, dy);
    }
    menu.close();
    redraw();
  };
  const choose = (px, py, byKeyboard = false) => {
    const vertex = graph.nearest(...view.toMetre(px, py), PICK_PIXELS / view.scale);
    if (!vertex) return menu.close();
    if (stretch.active) return stretch.take(vertex);
    menu.open(vertex, px, py, byKeyboard);
    return redraw();
  };

  byId("map-fit").addEventListener("click", fit);
  byId("map-follow").addEventListener("click", () => follow(!following));
  byId("map-in").addEventListener("click", () => zoom(1.4));
  byId("map-out").addEventListener("click", () => zoom(1 / 1.4));
  const keys = {
    ArrowLeft: () => pan(40, 0), ArrowRight: () => pan(-40, 0), ArrowUp: () => pan(0, 40), ArrowDown: () => pan(0, -40),
    "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), f: fit, r: () => follow(!following),
    ",": () => zoom(1, undefined, undefined, TURN), ".": () => zoom(1, undefined, undefined, -TURN),
    Enter: () => choose(view.width / 2, view.height / 2, true),
  };
  listen(canvas, {
    pan, zoom,
    tap: (x, y) => choose(x, y),
    hover: (x, y) => {
      hovered = x === null ? null : graph.nearest(...view.toMetre(x, y), PICK_PIXELS / view.scale);
      canvas.style.cursor = hovered ? "pointer" : "";
      redraw();
    },
    key: (event) => {
      if (event.key === "Escape" && stretch.active) {
        event.stopPropagation();
        stretch.end();
        return true;
      }
      const act = keys[event.key];
      if (act) act();
      return Boolean(act);
    },
  });

  for (const key of ["live", "route", "state"]) link.on(key, redraw);
  graph.addEventListener("changed", () => {
    for (const id of cache.keys()) if (!graph.maps.has(id)) cache.delete(id);
    redraw();
  });
  link.addEventListener("all", () => {
    if (!fitted) fit();
    fitted = true;
  });
  link.on("graph", (facts) => {
    byId("map-empty").hidden = !facts || facts.vertices > 0;
    say(byId("map-facts"), facts ? `${facts.maps} maps, ${facts.vertices.toLocaleString()} vertices` : "");
    legend(graph);
    if (facts?.vertices > 0 && !canvas.dataset.fitted) {
      canvas.dataset.fitted = "true";
      fit();
    }
  });
  window.addEventListener("theme", () => { legend(graph); redraw(); });
  new ResizeObserver(redraw).observe(canvas);

  const frameLoop = () => {
    requestAnimationFrame(frameLoop);
    if (!dirty) return;
    dirty = false;
    const live = link.values.get("live");
    if (following && live?.pose) [view.x, view.y] = live.pose;
    draw({ canvas, view, graph, cache, background, stretch, menu, hovered, live, route: link.values.get("route"), state: link.values.get("state") });
  };
  frameLoop();
  globalThis.vtrMap = { view, graph }; // for tests, and for whoever writes a script
}

function draw(scene) {
  const { canvas, view, graph, live, route, state } = scene;
  const ratio = devicePixelRatio || 1;
  const size = [Math.round(view.width * ratio), Math.round(view.height * ratio)];
  if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
  const context = canvas.getContext("2d");
  const colours = layers.palette();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, ...size);
  view.enter(context, ratio);
  scene.background.draw(context, view);
  const step = layers.drawGrid(context, view, colours);
  const routed = route && state?.route && (route.id === state.route || route.id === state.extends);
  if (routed) layers.drawRoute(context, view, graph, route, colours);
  for (const one of graph.restrictions) layers.drawStretch(context, view, graph, one, one.speed ? colours.warn : colours.bad, 13);
  layers.drawMaps(context, view, graph, colours, scene.cache);
  layers.drawJoints(context, view, graph, colours);
  const marking = scene.stretch.shown(scene.hovered);
  if (marking) layers.drawStretch(context, view, graph, marking, colours.blue, 15);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  drawMarks(context, scene, colours);
  if (live?.pose) layers.drawRobot(context, view, live.pose, colours, live.by === "localization" || live.by === "odometry");
  layers.drawScaleBar(context, view, colours, step);
  if (document.activeElement === canvas && canvas.matches(":focus-visible")) cross(context, view, colours);
}

function drawMarks(context, { view, graph, live, state, hovered, menu, stretch }, colours) {
  const mark = (text, colour, radius, filled) => {
    const point = graph.find(text);
    if (point) layers.drawMark(context, view, point, colour, radius, filled);
  };
  for (const one of [hovered, menu.chosen, stretch.first]) {
    if (one) layers.drawMark(context, view, graph.at(one.map, one.index) ?? [0, 0], colours.blue, 8);
  }
  if (live?.trunk) mark(live.trunk, colours.good, 10);
  if (state?.pauses_at) mark(state.pauses_at, colours.warn, 9, true);
  for (const one of graph.restrictions) {
    const middle = graph.at(one.map, Math.floor((one.first + one.last) / 2));
    const text = one.speed ? `≤ ${one.speed} m/s` : "closed";
    if (middle) layers.drawLabel(context, view, middle, text, colours, { dy: 18 });
  }
  for (const [name, [map, index]] of Object.entries(graph.places)) {
    const point = graph.at(map, index);
    if (!point) continue;
    layers.drawMark(context, view, point, colours.text, 4, true);
    layers.drawLabel(context, view, point, name, colours, { dy: -16 });
  }
  const goals = [state?.goal, ...(state?.goals ?? []).map((goal) => goal.to)].filter(Boolean);
  goals.forEach((goal, number) => {
    const point = graph.find(goal);
    if (point) layers.drawLabel(context, view, point, number === 0 ? "⚑ goal" : `⚑ ${number}`, colours, { flag: true, dy: 20 });
  });
}

function cross(context, view, colours) {
  const [x, y] = [view.width / 2, view.height / 2];
  context.strokeStyle = colours.blue;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x - 10, y);
  context.lineTo(x + 10, y);
  context.moveTo(x, y - 10);
  context.lineTo(x, y + 10);
  context.stroke();
}

/** Which colour is which age. */
function legend(graph) {
  const dark = document.documentElement.dataset.theme === "dark";
  const oldest = Math.min(...[...graph.maps.values()].map((map) => map.about.stamp), Date.now());
  const days = (Date.now() - oldest) / 86400e3;
  const ages = [[0, "now"], [1 / 24, "1 h"], [1, "1 day"], [7, "1 week"], [30, "1 month"], [365, "1 year"]].filter(([age]) => age <= Math.max(days * 2, 1 / 24));
  byId("legend").replaceChildren(...ages.map(([age, name]) => {
    const swatch = make("span", { class: "swatch" });
    swatch.style.background = layers.ageColour(Date.now() - age * 86400e3, dark);
    return make("li", {}, swatch, name);
  }));
}
