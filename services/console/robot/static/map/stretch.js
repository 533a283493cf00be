// Marks a stretch of a map: from one vertex to another, closed or with a speed limit.

import { byId, say } from "/static/common/dom.js";

export class Stretch {
  constructor(link, frame, commands, redraw) {
    Object.assign(this, { link, frame, redraw, active: false, first: null, last: null });
    commands.bind(byId("map-stretch"), "restrict", () => (this.active ? this.end() : this.begin(null)));
  }

  /** Waits for the first vertex, or for the last where the first is known. */
  begin(first) {
    this.active = true;
    this.first = first;
    this.last = null;
    this.#hint();
  }

  end() {
    this.active = false;
    this.first = this.last = null;
    this.#hint();
  }

  /** Takes a vertex that was chosen; the stretch is marked with the second one. */
  async take(vertex) {
    if (!this.first) {
      this.first = vertex;
      return this.#hint();
    }
    if (vertex.map !== this.first.map) {
      return this.frame.toast("A stretch lies on one map: choose a vertex of the same map.", true);
    }
    const stretch = this.shown(vertex);
    this.last = vertex;
    this.redraw();
    const wish = await this.frame.ask(`Mark vertices ${stretch.first} to ${stretch.last}`, [
      { name: "what", label: "From now on", options: [["limit", "drive no faster than"], ["close", "do not drive here"], ["free", "drive as usual"]] },
      { name: "speed", label: "Speed, m/s (for a limit)", type: "number", value: 0.5, min: 0.01, max: 10, step: 0.01 },
      { name: "reason", label: "Why" },
    ], "Mark it", "A route that leads here is planned anew at once.");
    this.end();
    if (!wish) return undefined;
    const speed = { limit: Number(wish.speed), close: 0, free: null }[wish.what];
    return this.frame.act("restrict", { restriction: { ...stretch, speed, reason: wish.reason } });
  }

  lift(marked) {
    const { map, first, last } = marked;
    return this.frame.act("restrict", { restriction: { map, first, last, speed: null } });
  }

  /** The stretch up to a vertex, for drawing; null where there is none. */
  shown(vertex) {
    const end = this.last ?? vertex;
    if (!this.first || !end || end.map !== this.first.map) return null;
    return {
      map: this.first.map,
      first: Math.min(this.first.index, end.index),
      last: Math.max(this.first.index, end.index),
    };
  }

  #hint() {
    byId("map-stretch").setAttribute("aria-pressed", String(this.active));
    const hint = byId("map-hint");
    hint.hidden = !this.active;
    say(hint, this.first ? "Choose the last vertex of the stretch." : "Choose the first vertex of the stretch.");
    this.redraw();
  }
}
