// An image or a folder of tiles under the map, and how it is moved, rotated and scaled there.

import { byId, make } from "/static/common/dom.js";

const TILE = 256;

export class Background {
  constructor(link, frame, redraw) {
    this.link = link;
    this.frame = frame;
    this.redraw = redraw;
    this.available = [];
    this.shown = null; // { name, x, y, rotation, scale, opacity }: middle (m), rad, metres a pixel
    this.moving = false;
    this.images = new Map();
    link.on("background", (section) => {
      this.available = section?.available ?? [];
      if (!this.moving) this.shown = section?.shown ?? null;
      this.#panel();
      redraw();
    });
    byId("map-back").addEventListener("click", () => {
      const panel = byId("background");
      panel.hidden = !panel.hidden;
      byId("map-back").setAttribute("aria-expanded", String(!panel.hidden));
      if (panel.hidden) this.#stopMoving(false);
    });
  }

  /** Drawn in metres. */
  draw(context, view) {
    const kind = this.available.find((one) => one.name === this.shown?.name);
    if (!kind) return;
    context.save();
    context.translate(this.shown.x, this.shown.y);
    context.rotate(this.shown.rotation);
    context.scale(this.shown.scale, -this.shown.scale);
    context.globalAlpha = this.shown.opacity;
    if (kind.kind === "image") this.#drawImage(context);
    else this.#drawTiles(context, view, kind);
    context.restore();
  }

  pan(dx, dy) { this.#change({ x: this.shown.x + dx, y: this.shown.y + dy }); }

  zoom(factor, turn = 0) {
    this.#change({ scale: this.shown.scale * factor, rotation: this.shown.rotation + turn });
  }

  #change(part) {
    this.shown = { ...this.shown, ...part };
    this.redraw();
  }

  #drawImage(context) {
    const image = this.#load(encodeURIComponent(this.shown.name));
    if (image) context.drawImage(image, -image.width / 2, -image.height / 2);
  }

  #drawTiles(context, view, kind) {
    const [low, high] = kind.zooms;
    const wanted = high - Math.round(Math.log2(Math.max(1 / (view.scale * this.shown.scale), 1)));
    const zoom = Math.min(Math.max(wanted, low), high);
    const size = TILE * 2 ** (high - zoom);
    const middle = [(kind.x[0] + kind.x[1] + 1) * TILE / 2, (kind.y[0] + kind.y[1] + 1) * TILE / 2];
    const inverse = context.getTransform().inverse();
    const box = [[0, 0], [1, 0], [0, 1], [1, 1]].map(([u, v]) => inverse.transformPoint(
      { x: u * context.canvas.width, y: v * context.canvas.height }));
    const range = (axis, offset) => {
      const values = box.map((point) => (point[axis] + offset) / size);
      return [Math.floor(Math.min(...values)), Math.floor(Math.max(...values))];
    };
    const shift = 2 ** (high - zoom);
    const [x0, x1] = range("x", middle[0]);
    const [y0, y1] = range("y", middle[1]);
    for (let x = Math.max(x0, Math.floor(kind.x[0] / shift)); x <= Math.min(x1, Math.floor(kind.x[1] / shift)); x += 1) {
      for (let y = Math.max(y0, Math.floor(kind.y[0] / shift)); y <= Math.min(y1, Math.floor(kind.y[1] / shift)); y += 1) {
        const tile = this.#load(`${encodeURIComponent(this.shown.name)}/${zoom}/${x}/${y}${kind.suffix}`);
        if (tile) context.drawImage(tile, x * size - middle[0], y * size - middle[1], size, size);
      }
    }
  }

  /** An image that is there, or null until it has come. */
  #load(path) {
    if (!this.images.has(path)) {
      const image = new Image();
      image.onload = () => this.redraw();
      image.src = `/data/robot/background/${path}`;
      this.images.set(path, image);
      if (this.images.size > 400) this.images.delete(this.images.keys().next().value);
    }
    const image = this.images.get(path);
    return image.complete && image.naturalWidth ? image : null;
  }

  #panel() {
    const select = make("select", { "aria-label": "Background", onchange: (event) => this.#choose(event.target.value) },
      make("option", { value: "" }, "none"),
      ...this.available.map((one) => make("option", { value: one.name, selected: one.name === this.shown?.name }, one.name)));
    const upload = make("input", { type: "file", accept: "image/png,image/jpeg,image/webp", "aria-label": "Upload an image",
      onchange: (event) => this.#upload(event.target.files[0]) });
    const opacity = make("input", { type: "range", min: 0.1, max: 1, step: 0.05, value: this.shown?.opacity ?? 0.6, "aria-label": "Opacity",
      oninput: (event) => this.shown && this.#change({ opacity: Number(event.target.value) }), onchange: () => this.shown && !this.moving && this.#save() });
    const move = make("button", { type: "button", "aria-pressed": String(this.moving), disabled: !this.shown, onclick: () => this.#toggle() },
      this.moving ? "Keep it so" : "Move, rotate, scale");
    const undo = make("button", { type: "button", onclick: () => this.#stopMoving(false) }, "Back as it was");
    byId("background").replaceChildren(
      make("div", { class: "row" }, make("label", { class: "grow" }, "Shown", select), make("label", { class: "grow" }, "New image", upload)),
      make("div", { class: "row" }, make("label", { class: "grow" }, "Opacity", opacity), move, ...(this.moving ? [undo] : [])),
      make("p", { class: "soft small" }, this.moving
        ? "Drag moves the background, the wheel or + and − scale it, Shift with either, or , and ., turn it."
        : "A folder of tiles z/x/y.png can be put beside the images in the console's folder of backgrounds."));
  }

  #choose(name) {
    if (!name) return this.frame.act("background", { shown: null });
    this.shown = { name, x: 0, y: 0, rotation: 0, scale: 0.05, opacity: 0.6 };
    return this.#save();
  }

  #toggle() {
    if (this.moving) {
      this.moving = false;
      this.#save();
    } else {
      this.moving = true;
    }
    this.#panel();
  }

  #stopMoving(keep) {
    if (!this.moving) return;
    this.moving = false;
    if (!keep) this.shown = this.link.values.get("background")?.shown ?? null;
    this.#panel();
    this.redraw();
  }

  #save() { return this.frame.act("background", { shown: this.shown }); }

  async #upload(file) {
    if (!file) return;
    try {
      const answer = await fetch(`/data/robot/background/${encodeURIComponent(file.name)}`, { method: "POST", body: file });
      const { told } = answer.headers.get("Content-Type")?.includes("json") ? await answer.json() : { told: await answer.text() };
      this.frame.toast(told, !answer.ok);
      if (answer.ok) this.#choose(file.name);
    } catch {
      this.frame.toast("The image could not be sent.", true);
    }
  }
}
