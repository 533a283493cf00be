// How alike maps look, two by two; the pointer or the arrow keys read a cell.

import { make } from "/static/common/dom.js";
import { fitted } from "/static/fleet/svg.js";

const LEFT = 4;
const SIDE = 520;
// From little to much alike: even steps of lightness, told apart by whoever sees no colour (viridis).
const SCALE = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]];

export class Matrix {
  /** `read(text)` is told of the cell that the pointer is at. */
  constructor(element, read) {
    this.element = element;
    this.read = read;
    this.cell = null;
    this.canvas = make("canvas", {
      tabindex: 0, role: "img",
      onpointermove: (event) => this.#point(event), onpointerleave: () => this.#choose(null),
      onkeydown: (event) => this.#key(event), onblur: () => this.#choose(null),
    });
    this.legend = make("div", { class: "scale" }, make("span", { class: "figure" }), make("i"), make("span", { class: "figure" }));
    const colours = SCALE.map((rgb) => `rgb(${rgb})`).join(",");
    this.legend.children[1].style.background = `linear-gradient(90deg, ${colours})`;
    element.append(this.canvas, this.legend);
    fitted(element, (width) => { this.width = width; this.draw(); });
  }

  /** Draws `{maps, hours, values}`, the maps by time; null where there is none. */
  show(found) {
    this.found = found;
    this.cell = null;
    this.element.hidden = !found;
    if (found) {
      const order = found.hours.map((_, k) => k).sort((a, b) => found.hours[a] - found.hours[b]);
      this.maps = order.map((k) => found.maps[k]);
      this.values = order.map((k) => order.map((j) => found.values[k][j]));
      const others = this.values.flatMap((row, k) => row.filter((_, j) => j !== k));
      this.low = Math.min(...others, 1);
      this.high = Math.max(...others, this.low + 1e-3);
    }
    this.draw();
  }

  draw() {
    if (!this.found || !this.width) return;
    const side = Math.min(this.width - LEFT, SIDE);
    const n = this.maps.length;
    const scale = window.devicePixelRatio || 1;
    Object.assign(this.canvas, { width: Math.round(side * scale), height: Math.round(side * scale) });
    this.canvas.style.width = this.canvas.style.height = `${side}px`;
    const context = this.canvas.getContext("2d");
    const edge = (k) => Math.round((k * this.canvas.width) / n);
    this.values.forEach((row, k) => row.forEach((value, j) => {
      context.fillStyle = this.#colour(value);
      context.fillRect(edge(j), edge(k), edge(j + 1) - edge(j), edge(k + 1) - edge(k));
    }));
    if (this.cell) {
      const [k, j] = this.cell;
      context.strokeStyle = "#fff";
      context.lineWidth = 2 * scale;
      context.strokeRect(edge(j), edge(k), edge(j + 1) - edge(j), edge(k + 1) - edge(k));
    }
    this.canvas.setAttribute("aria-label", `Similarity of ${n} maps by time; arrow keys read it`);
    this.legend.children[0].textContent = this.low.toFixed(2);
    this.legend.children[2].textContent = this.high.toFixed(2);
  }

  #colour(value) {
    const place = Math.min(Math.max((value - this.low) / (this.high - this.low), 0), 1) * (SCALE.length - 1);
    const k = Math.min(Math.floor(place), SCALE.length - 2);
    const part = place - k;
    return `rgb(${SCALE[k].map((from, c) => Math.round(from + part * (SCALE[k + 1][c] - from))).join(",")})`;
  }

  #point(event) {
    if (!this.found) return;
    const box = this.canvas.getBoundingClientRect();
    const n = this.maps.length;
    const at = (position, size) => Math.min(Math.max(Math.floor((n * position) / size), 0), n - 1);
    this.#choose([at(event.clientY - box.top, box.height), at(event.clientX - box.left, box.width)]);
  }

  #key(event) {
    const moves = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
    const move = moves[event.key];
    if (!move || !this.found) return;
    event.preventDefault();
    const n = this.maps.length;
    const from = this.cell ?? [0, 0];
    this.#choose(from.map((value, k) => Math.min(Math.max(value + move[k], 0), n - 1)));
  }

  #choose(cell) {
    if (String(cell) === String(this.cell)) return;
    this.cell = cell;
    this.draw();
    this.read(cell ? `${this.maps[cell[0]]} and ${this.maps[cell[1]]}: ${this.values[cell[0]][cell[1]].toFixed(3)}` : "");
  }
}
