// From metres to pixels and back: a middle, a scale, a rotation.

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.x = 0;
    this.y = 0;
    this.scale = 20; // pixels a metre
    this.rotation = 0;
  }

  get width() { return this.canvas.clientWidth; }
  get height() { return this.canvas.clientHeight; }

  /** [px, py] of a point in metres. */
  toPixel(x, y) {
    const [c, s] = [Math.cos(this.rotation), Math.sin(this.rotation)];
    const [dx, dy] = [x - this.x, y - this.y];
    return [this.width / 2 + (c * dx - s * dy) * this.scale, this.height / 2 - (s * dx + c * dy) * this.scale];
  }

  /** [x, y] in metres of a pixel. */
  toMetre(px, py) {
    const [c, s] = [Math.cos(this.rotation), Math.sin(this.rotation)];
    const [u, v] = [(px - this.width / 2) / this.scale, (this.height / 2 - py) / this.scale];
    return [this.x + c * u + s * v, this.y - s * u + c * v];
  }

  /** Sets a context up so that it draws in metres, y up. */
  enter(context, ratio) {
    const [c, s] = [Math.cos(this.rotation) * this.scale * ratio, Math.sin(this.rotation) * this.scale * ratio];
    const [dx, dy] = [this.width * ratio / 2, this.height * ratio / 2];
    context.setTransform(c, -s, -s, -c, dx - c * this.x + s * this.y, dy + s * this.x + c * this.y);
  }

  /** Moves what is shown by pixels. */
  pan(dpx, dpy) {
    const [x0, y0] = this.toMetre(0, 0);
    const [x1, y1] = this.toMetre(dpx, dpy);
    this.x -= x1 - x0;
    this.y -= y1 - y0;
  }

  /** Scales and turns around a pixel, which keeps its place. */
  zoom(factor, px, py, turn = 0) {
    const [x, y] = this.toMetre(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, 0.05), 500);
    this.rotation += turn;
    const [nx, ny] = this.toMetre(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  /** Shows a box of metres. */
  fit(box) {
    if (!box) return;
    const [c, s] = [Math.abs(Math.cos(this.rotation)), Math.abs(Math.sin(this.rotation))];
    const [w, h] = [box.x1 - box.x0 + 2, box.y1 - box.y0 + 2];
    this.x = (box.x0 + box.x1) / 2;
    this.y = (box.y0 + box.y1) / 2;
    this.scale = Math.min(Math.max(Math.min(this.width / (w * c + h * s), this.height / (w * s + h * c)) * 0.92, 0.05), 120);
  }
}
