// Places, and the maps between them: an arc each, the plan's thick and numbered.

import { fitted, svg } from "/static/fleet/svg.js";

const EDGE = 42;
const ROOM = 10; // left beside the outermost arc
const LARGE = 14; // radius of a place whose name stands in it
const SMALL = 8;
const ARCS = 6; // drawn between two places; the others are counted
const BEND = [0.13, 22]; // of the first arc's middle: a part of the distance, pixels at most
const APART = [0.1, 11]; // of each further one from the one before

export class Graph {
  /** `pick(place, isStart)` is told which place somebody chooses. */
  constructor(element, pick) {
    this.element = element;
    this.pick = pick;
    this.width = 0;
    fitted(element, (width, height) => { Object.assign(this, { width, height }); this.draw(); });
  }

  /** Draws `places` [{name, label, at}] and `routes` [{start, end, maps}] with `rows` of costs; `order` numbers the plan's. */
  show(places, routes, rows, order, ends) {
    Object.assign(this, { places, routes, rows, order, ends });
    this.draw();
  }

  draw() {
    if (!this.places || !this.width) return;
    const focused = document.activeElement?.closest?.("[data-place]")?.dataset.place;
    this.byRoute = grouped(this.rows);
    this.radius = new Map(this.places.map((place) => [place.name, place.label.length <= 3 ? LARGE : SMALL]));
    this.at = this.#positions([EDGE, EDGE, EDGE, EDGE]);
    this.at = this.#positions(this.#margins());
    const thin = [];
    const thick = [];
    for (const route of this.routes) this.#route(route, thin, thick);
    const nodes = this.places.filter((place) => this.at.has(place.name)).map((place) => this.#place(place));
    const label = `${this.places.length} places and the maps between them`;
    this.element.replaceChildren(svg("svg", { width: this.width, height: this.height, role: "group", "aria-label": label },
      svg("g", {}, ...thin), svg("g", {}, ...thick), svg("g", {}, ...nodes)));
    if (focused) this.element.querySelector(`[data-place="${CSS.escape(focused)}"]`)?.focus();
  }

  /** What has to stay free at the left, right, top and bottom so that no arc leaves the drawing. */
  #margins() {
    const margins = [EDGE, EDGE, EDGE, EDGE];
    for (const route of this.routes) {
      const [a, b] = [this.at.get(route.start), this.at.get(route.end)];
      if (!a || !b || route.start === route.end) continue;
      const [x, y] = this.#arc(route, Math.min(route.maps, ARCS + 1) - 1).middle;
      [x, this.width - x, y, this.height - y].forEach((room, k) => {
        margins[k] = Math.max(margins[k], Math.min(EDGE + ROOM - room, this.width / 4));
      });
    }
    return margins;
  }

  /** The places in pixels, the whole turned so that it lies flat and fills the drawing. */
  #positions([left, right, above, below]) {
    const drawn = this.places.filter((place) => place.at);
    const turned = flat(drawn.map((place) => place.at));
    const [west, east] = [Math.min(...turned.map((p) => p[0])), Math.max(...turned.map((p) => p[0]))];
    const [south, north] = [Math.min(...turned.map((p) => p[1])), Math.max(...turned.map((p) => p[1]))];
    const scale = (room, size) => (size > 1e-9 ? room / size : Infinity);
    const across = scale(this.width - left - right, east - west);
    const down = scale(this.height - above - below, north - south);
    const [sx, sy] = [Math.min(across, 1.6 * down), Math.min(down, 1.6 * across)].map((s) => (Number.isFinite(s) ? s : 0));
    return new Map(drawn.map((place, k) => [place.name, [
      (left + this.width - right) / 2 + sx * (turned[k][0] - (west + east) / 2),
      (above + this.height - below) / 2 - sy * (turned[k][1] - (south + north) / 2),
    ]]));
  }

  #arc(route, k) {
    const ends = [route.start, route.end];
    const [a, b] = ends.map((name) => this.at.get(name));
    return route.start === route.end ? loop(a, k) : curve(a, b, k, ends.map((name) => this.radius.get(name)));
  }

  #route(route, thin, thick) {
    if (!this.at.has(route.start) || !this.at.has(route.end)) return;
    const rows = this.byRoute.get(`${route.start} ${route.end}`) ?? [];
    const chosen = rows.filter((row) => this.order.has(row.map));
    const others = rows.filter((row) => !this.order.has(row.map)).slice(0, Math.max(ARCS - chosen.length, 0));
    const shown = [...chosen, ...others];
    shown.forEach((row, k) => {
      const number = this.order.get(row.map);
      const arc = this.#arc(route, k);
      const title = `${row.name}, ${row.from} → ${row.to}, ${row.length.toFixed(1)} m: ${row.edge.toFixed(3)}`;
      const kind = number === undefined ? "edge" : `edge chosen stage-${number % 8}`;
      const parts = [svg("title", {}, title), svg("path", { class: "line", d: arc.path }), svg("path", { class: "tip", d: arc.tip })];
      if (number !== undefined) {
        parts.push(svg("g", { class: "number", transform: `translate(${arc.middle})` },
          svg("circle", { r: 9 }), svg("text", { y: 4, "text-anchor": "middle" }, String(number + 1))));
      }
      (number === undefined ? thin : thick).push(svg("g", { class: kind }, ...parts));
    });
    const more = route.maps - shown.length;
    if (more > 0 && route.start !== route.end) {
      const arc = this.#arc(route, shown.length);
      thin.push(svg("text", { class: "tick", x: arc.middle[0], y: arc.middle[1] + 4, "text-anchor": "middle" }, `+${more}`));
    }
  }

  #place(place) {
    const [x, y] = this.at.get(place.name);
    const radius = this.radius.get(place.name);
    const inside = radius === LARGE;
    const role = place.name === this.ends[0] ? "start" : place.name === this.ends[1] ? "goal" : "";
    const pick = (event) => this.pick(place.name, event.shiftKey);
    return svg("g", {
      class: `place ${role}`, transform: `translate(${x},${y})`, tabindex: 0, role: "button", "data-place": place.name,
      "aria-label": `Place ${place.label}${role ? `, the ${role}` : ""}: choose as goal, with Shift as start`,
      onclick: pick,
      onkeydown: (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); pick(event); } },
    }, svg("circle", { r: radius }),
    svg("text", { y: inside ? 4.5 : -14, "text-anchor": anchor(x, this.width, inside), class: inside ? "in" : "out" }, place.label));
  }
}

/** Rows by the route that they are of. */
function grouped(rows) {
  const found = new Map();
  for (const row of rows) {
    const key = `${row.start} ${row.end}`;
    if (!found.has(key)) found.set(key, []);
    found.get(key).push(row);
  }
  return found;
}

function anchor(x, width, inside) {
  if (inside) return "middle";
  if (x < 70) return "start";
  return x > width - 70 ? "end" : "middle";
}

/** The k-th arc from one place to another, to the left of the straight line, with its tip and its middle. */
function curve([ax, ay], [bx, by], k, [ra, rb]) {
  const [dx, dy] = [bx - ax, by - ay];
  const size = Math.hypot(dx, dy) || 1;
  const [first, next] = [BEND, APART].map(([part, most]) => Math.min(part * size, most));
  const bend = (first + k * next) / size;
  const control = [(ax + bx) / 2 + bend * 2 * dy, (ay + by) / 2 - bend * 2 * dx];
  const begin = toward([ax, ay], control, ra + 2);
  const point = toward([bx, by], control, rb + 3);
  const end = toward([bx, by], control, rb + 10);
  const middle = [0.25 * ax + 0.5 * control[0] + 0.25 * bx, 0.25 * ay + 0.5 * control[1] + 0.25 * by];
  return { path: `M${begin}Q${control} ${end}`, tip: tip(end, point), middle };
}

/** A map that ends where it began. */
function loop([x, y], k) {
  const r = 16 + 7 * k;
  const [begin, end] = [[x - 8, y - LARGE], [x + 8, y - LARGE - 5]];
  const path = `M${begin}C${[x - 2.2 * r, y - LARGE - 2.4 * r]} ${[x + 2.2 * r, y - LARGE - 2.4 * r]} ${end}`;
  return { path, tip: tip(end, [x + 6, y - LARGE + 1]), middle: [x, y - LARGE - 1.8 * r] };
}

function tip(end, point) {
  const [dx, dy] = [point[0] - end[0], point[1] - end[1]];
  return `M${point}L${[end[0] - 0.65 * dy, end[1] + 0.65 * dx]}L${[end[0] + 0.65 * dy, end[1] - 0.65 * dx]}Z`;
}

function toward([ax, ay], [bx, by], by_px) {
  const size = Math.hypot(bx - ax, by - ay) || 1;
  return [ax + ((bx - ax) * by_px) / size, ay + ((by - ay) * by_px) / size];
}

/** Points turned about their middle so that they extend furthest from left to right. */
function flat(points) {
  const n = points.length || 1;
  const [mx, my] = [0, 1].map((k) => points.reduce((sum, p) => sum + p[k], 0) / n);
  let [xx, xy, yy] = [0, 0, 0];
  for (const [x, y] of points) {
    xx += (x - mx) ** 2;
    xy += (x - mx) * (y - my);
    yy += (y - my) ** 2;
  }
  const angle = 0.5 * Math.atan2(2 * xy, xx - yy);
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return points.map(([x, y]) => [c * (x - mx) + s * (y - my), -s * (x - mx) + c * (y - my)]);
}
