// The pose graph as it was sent: maps with their vertices in metres, places, restrictions, joints.

export class Graph extends EventTarget {
  constructor(link) {
    super();
    this.maps = new Map(); // id → { about, chunks: [Float32Array of x, y], version }
    this.places = {};
    this.restrictions = [];
    this.joints = [];
    link.on("map/*", (about, key) => this.#map(key.slice(4), about));
    link.on("v/*", (values, key) => this.#chunk(key, values));
    link.on("places", (places) => this.#keep("places", places ?? {}));
    link.on("restrictions", (list) => this.#keep("restrictions", list ?? []));
    link.on("joints", (list) => this.#keep("joints", list ?? []));
  }

  /** [x, y] of a vertex, or null. */
  at(mapId, index) {
    const map = this.maps.get(mapId);
    const chunk = map?.chunks[Math.floor(index / 256)];
    const within = (index % 256) * 2;
    return chunk && within < chunk.length ? [chunk[within], chunk[within + 1]] : null;
  }

  /** [x, y] of a vertex written as map:index, or of a place; null where there is none. */
  find(text) {
    if (!text) return null;
    const vertex = this.places[text] ?? parse(text);
    return vertex ? this.at(...vertex) : null;
  }

  size(mapId) {
    const chunks = this.maps.get(mapId)?.chunks ?? [];
    return chunks.reduce((sum, chunk) => sum + chunk.length / 2, 0);
  }

  /** Calls with (x, y, index) for each vertex of a map from first to last. */
  each(mapId, call, first = 0, last = Infinity) {
    const end = Math.min(last, this.size(mapId) - 1);
    for (let index = first; index <= end; index += 1) {
      const point = this.at(mapId, index);
      if (point) call(point[0], point[1], index);
    }
  }

  /** The vertex nearest to a point, taught maps first: { map, index, metres }, or null beyond a distance. */
  nearest(x, y, within) {
    let best = null;
    for (const [id, map] of this.maps) {
      const handicap = map.about.generation === 0 ? 1 : 1.6;
      this.each(id, (vx, vy, index) => {
        const metres = Math.hypot(vx - x, vy - y);
        if (metres <= within && (!best || metres * handicap < best.rank)) {
          best = { map: id, index, metres, rank: metres * handicap };
        }
      });
    }
    return best;
  }

  /** { x0, y0, x1, y1 } around all vertices; null where there are none. */
  bounds() {
    const box = { x0: Infinity, y0: Infinity, x1: -Infinity, y1: -Infinity };
    for (const id of this.maps.keys()) {
      this.each(id, (x, y) => {
        box.x0 = Math.min(box.x0, x);
        box.x1 = Math.max(box.x1, x);
        box.y0 = Math.min(box.y0, y);
        box.y1 = Math.max(box.y1, y);
      });
    }
    return box.x0 <= box.x1 ? box : null;
  }

  nameOf(mapId, index) {
    return Object.keys(this.places).find((name) => this.places[name][0] === mapId && this.places[name][1] === index);
  }

  #map(id, about) {
    if (about === undefined) this.maps.delete(id);
    else this.#entry(id).about = about;
    this.#changed();
  }

  #chunk(key, values) {
    const [, id, chunk] = key.split("/");
    const map = values === undefined ? this.maps.get(id) : this.#entry(id);
    if (!map) return;
    if (values === undefined) map.chunks.length = Math.min(map.chunks.length, Number(chunk));
    else map.chunks[Number(chunk)] = Float32Array.from(values, (value) => value / 100);
    map.version += 1;
    this.#changed();
  }

  #entry(id) {
    if (!this.maps.has(id)) this.maps.set(id, { about: { generation: 0, stamp: 0 }, chunks: [], version: 0 });
    return this.maps.get(id);
  }

  #keep(name, value) {
    this[name] = value;
    this.#changed();
  }

  #changed() { this.dispatchEvent(new Event("changed")); }
}

/** ["map", index] of map:index, or null. */
export function parse(text) {
  const match = /^([^:]+):(\d+)$/.exec(text);
  return match ? [match[1], Number(match[2])] : null;
}

/** A map's id as people tell maps apart: when it was recorded. */
export function shortName(mapId, about) {
  const time = about?.stamp ? new Date(about.stamp) : null;
  const kind = about?.generation ? "repeat" : "taught";
  return time ? `${kind} ${time.toLocaleDateString()} ${time.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })}` : mapId;
}
