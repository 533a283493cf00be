// The power of each period, what chance reaches, and the rhythms that are claimed.

import { anchored, fitted, short, svg, ticks } from "/static/fleet/svg.js";

const HEIGHT = 240;
const EDGE = { left: 40, right: 12, top: 26, bottom: 32 };
const PERIODS = [[1, "1 h"], [3, "3 h"], [6, "6 h"], [12, "12 h"], [24, "1 d"], [48, "2 d"], [96, "4 d"], [168, "1 wk"], [730.5, "1 mo"], [4383, "6 mo"], [8766, "1 yr"], [43830, "5 yr"]];
const ROOM = 34;

export class Spectrum {
  constructor(element) {
    this.element = element;
    fitted(element, (width) => { this.width = width; this.draw(); });
  }

  /** Draws `{periods, power, levels}` and marks rhythms; null where there is none. */
  show(found, rhythms) {
    Object.assign(this, { found, rhythms });
    this.element.hidden = !found;
    this.draw();
  }

  draw() {
    const { found, width } = this;
    if (!found || !width) return;
    const [first, last] = [found.periods[0], found.periods.at(-1)].map(Math.log);
    const top = 1.12 * Math.max(...found.power, ...found.levels.map(([, power]) => power), 0.01);
    const x = (period) => EDGE.left + ((Math.log(period) - first) / (last - first || 1)) * (width - EDGE.left - EDGE.right);
    const y = (power) => HEIGHT - EDGE.bottom - (power / top) * (HEIGHT - EDGE.top - EDGE.bottom);
    const line = found.periods.map((period, k) => `${k ? "L" : "M"}${x(period).toFixed(1)},${y(found.power[k]).toFixed(1)}`).join("");
    const floor = `L${x(found.periods.at(-1))},${y(0)}L${x(found.periods[0])},${y(0)}Z`;
    this.element.replaceChildren(svg("svg", { width, height: HEIGHT, role: "img", "aria-label": "Power of each period" },
      ...axes(x, y, top, width, found.periods[0], found.periods.at(-1)),
      svg("path", { class: "power-area", d: line + floor }), svg("path", { class: "power", d: line }),
      ...found.levels.flatMap(([chance, power]) => level(chance, y(power), width)),
      ...this.rhythms.map((rhythm) => peak(rhythm, x, y, found, width))));
  }
}

function axes(x, y, top, width, first, last) {
  const parts = [svg("text", { class: "tick", x: 4, y: 12 }, "part of the variance explained, by period")];
  for (const value of ticks(0, top, 4)) {
    parts.push(svg("line", { class: "grid", x1: EDGE.left, x2: width - EDGE.right, y1: y(value), y2: y(value) }),
      svg("text", { class: "tick", x: EDGE.left - 6, y: y(value) + 4, "text-anchor": "end" }, short(value)));
  }
  let before = -Infinity;
  for (const [period, name] of PERIODS) {
    const at = x(period);
    if (period < first || period > last || at - before < ROOM) continue;
    before = at;
    parts.push(svg("line", { class: "grid", x1: at, x2: at, y1: EDGE.top, y2: HEIGHT - EDGE.bottom }),
      svg("text", { class: "tick", x: at, y: HEIGHT - 12, "text-anchor": "middle" }, name));
  }
  return parts;
}

function level(chance, y, width) {
  return [svg("line", { class: "level", x1: EDGE.left, x2: width - EDGE.right, y1: y, y2: y }),
    svg("text", { class: "tick level", x: width - EDGE.right - 2, y: y - 3, "text-anchor": "end" }, `${short(100 * chance)} % by chance`)];
}

function peak(rhythm, x, y, found, width) {
  const at = x(rhythm.period_hours);
  const nearest = found.periods.reduce((best, period, k) => (
    Math.abs(Math.log(period / rhythm.period_hours)) < Math.abs(Math.log(found.periods[best] / rhythm.period_hours)) ? k : best), 0);
  const height = y(found.power[nearest]);
  return svg("g", { class: "peak" }, svg("path", { d: `M${at},${height - 3}l-5,-9h10z` }),
    svg("text", { ...anchored(at, width), y: Math.max(height - 4, 22) }, rhythm.period));
}
