// The cost of each map over a day: thick what the plan chooses, thin the others; a line stands at the time of the drive.

import { anchored, fitted, short, svg, ticks } from "/static/fleet/svg.js";

const HEIGHT = 300;
const EDGE = { left: 44, right: 12, top: 14, bottom: 26 };
const NEAR_PX = 24;
const MARK_PX = 17;

export class Day {
  /** `pick(hour)` is told where somebody clicks, `hint(text)` what the pointer is at. */
  constructor(element, pick, hint) {
    this.element = element;
    this.pick = pick;
    this.hint = hint;
    this.curves = null;
    this.rows = new Map();
    this.order = new Map();
    this.hour = 0;
    this.width = 0;
    fitted(element, (width) => { this.width = width; this.draw(); });
  }

  /** Draws curves `{hours, maps, values}` anew. */
  show(curves) {
    this.curves = curves;
    this.draw();
  }

  /** Marks the time, and the maps of the plan: `order` has the number of each. */
  mark(hour, rows, order) {
    this.hour = hour;
    this.rows = new Map(rows.map((row) => [row.map, row]));
    this.order = order;
    this.#mark();
  }

  draw() {
    const { curves, width } = this;
    if (!curves || !width) return;
    const all = curves.values.flat();
    const [low, high] = span(Math.min(...all), Math.max(...all));
    this.x = (hour) => EDGE.left + (hour / 24) * (width - EDGE.left - EDGE.right);
    this.y = (cost) => HEIGHT - EDGE.bottom - ((cost - low) / (high - low)) * (HEIGHT - EDGE.top - EDGE.bottom);
    this.lines = curves.maps.map((map, k) => svg("path", { class: "curve", d: this.#path(curves.values[k]), "data-map": map }));
    this.front = svg("g");
    this.now = svg("g", { class: "now" });
    const picture = svg("svg", {
      width, height: HEIGHT, role: "img", "aria-label": `Cost of ${curves.maps.length} maps over the day`,
      onclick: (event) => this.pick(this.#hour(event)),
      onpointermove: (event) => this.#hover(event), onpointerleave: () => this.#lift(null),
    }, this.#axes(low, high), svg("g", {}, ...this.lines), this.now, this.front);
    this.element.replaceChildren(picture);
    this.#mark();
  }

  #axes(low, high) {
    const { width } = this;
    const every = width < 520 ? 6 : 3;
    const parts = [];
    for (const value of ticks(low, high, 5)) {
      const y = this.y(value);
      parts.push(svg("line", { class: "grid", x1: EDGE.left, x2: width - EDGE.right, y1: y, y2: y }),
        svg("text", { class: "tick", x: EDGE.left - 6, y: y + 4, "text-anchor": "end" }, short(value)));
    }
    for (let hour = 0; hour <= 24; hour += every) {
      const x = this.x(hour);
      const anchor = hour === 24 ? "end" : "middle";
      parts.push(svg("line", { class: "grid", x1: x, x2: x, y1: EDGE.top, y2: HEIGHT - EDGE.bottom }),
        svg("text", { class: "tick", x, y: HEIGHT - 8, "text-anchor": anchor }, `${String(hour).padStart(2, "0")}:00`));
    }
    parts.push(svg("text", { class: "tick", x: 4, y: 10 }, "J"));
    return svg("g", {}, ...parts);
  }

  #path(values) {
    return values.map((cost, k) => `${k ? "L" : "M"}${this.x(this.curves.hours[k]).toFixed(1)},${this.y(cost).toFixed(1)}`).join("");
  }

  #mark() {
    if (!this.lines) return;
    const chosen = [];
    for (const line of this.lines) {
      const number = this.order.get(line.dataset.map);
      line.setAttribute("class", number === undefined ? "curve" : `curve chosen stage-${number % 8}`);
      if (number !== undefined) chosen.push([number, line.dataset.map]);
    }
    const x = this.x(this.hour);
    this.now.replaceChildren(svg("line", { x1: x, x2: x, y1: EDGE.top, y2: HEIGHT - EDGE.bottom }));
    for (const line of this.lines) if (this.order.has(line.dataset.map)) line.parentNode.append(line);
    const marks = chosen.filter(([, map]) => this.rows.has(map)).map(([number, map]) => [number, this.y(this.rows.get(map).cost)]);
    this.front.replaceChildren(...beside(marks).map(([number, y, right]) => svg("g",
      { class: `mark stage-${number % 8}`, transform: `translate(${x + (x > this.width / 2 ? -right : right)},${y})` },
      svg("circle", { r: 8 }), svg("text", { y: 3.5, "text-anchor": "middle" }, String(number + 1)))));
  }

  #hour(event) {
    const box = this.element.getBoundingClientRect();
    const share = (event.clientX - box.left - EDGE.left) / (this.width - EDGE.left - EDGE.right);
    return Math.min(Math.max(24 * share, 0), 24);
  }

  #hover(event) {
    const hour = this.#hour(event);
    const step = Math.round(hour * (this.curves.hours.length - 1) / 24);
    const y = event.clientY - this.element.getBoundingClientRect().top;
    let best = null;
    this.curves.values.forEach((values, k) => {
      const apart = Math.abs(this.y(values[step]) - y);
      if (apart < NEAR_PX && (best === null || apart < best.apart)) best = { apart, k, step };
    });
    this.#lift(best);
  }

  #lift(found) {
    this.lifted?.remove();
    this.lifted = null;
    if (!found) return this.hint("");
    const map = this.curves.maps[found.k];
    const cost = this.curves.values[found.k][found.step];
    const hour = this.curves.hours[found.step];
    const row = this.rows.get(map);
    const name = row ? `${row.name}, ${row.from} → ${row.to}` : map;
    const [x, y] = [this.x(hour), this.y(cost)];
    this.lifted = svg("g", { class: "lifted" }, svg("path", { d: this.#path(this.curves.values[found.k]) }),
      svg("circle", { cx: x, cy: y, r: 4 }),
      svg("text", { ...anchored(x, this.width), y: Math.max(y - 8, 14) }, cost.toFixed(3)));
    this.front.before(this.lifted);
    return this.hint(`${name}: ${cost.toFixed(3)} at ${clock(hour)}`);
  }
}

/** Marks [number, y] with how far aside each stands, so that none hides another. */
function beside(marks) {
  const placed = [];
  for (const [number, y] of marks.sort((a, b) => a[0] - b[0])) {
    let right = 0;
    while (placed.some((other) => Math.abs(other[1] - y) < MARK_PX && other[2] === right)) right += MARK_PX;
    placed.push([number, y, right]);
  }
  return placed;
}

function clock(hour) {
  const minutes = Math.round(60 * hour);
  return `${String(Math.floor(minutes / 60)).padStart(2, "0")}:${String(minutes % 60).padStart(2, "0")}`;
}

function span(low, high) {
  if (!Number.isFinite(low)) return [0, 1];
  const pad = Math.max(0.05 * (high - low), 0.02);
  return [low - pad, high + pad];
}
