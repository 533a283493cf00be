// What is drawn on the map, from the bottom to the top.

const DAY_MS = 86400e3;
const DOTS_FROM = 14; // pixels a metre from which on vertices are seen one by one

export function palette() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  const dark = document.documentElement.dataset.theme === "dark";
  return {
    dark, text: of("--text"), soft: of("--soft"), line: of("--line"), card: of("--card"), accent: of("--accent"),
    good: of("--good"), warn: of("--warn"), bad: of("--bad"), blue: of("--blue"),
  };
}

/** The colour of an experience by its age: fresh ones are green, then blue and violet, and old ones fade to grey. */
export function ageColour(stamp, dark) {
  const days = Math.max((Date.now() - stamp) / DAY_MS, 0);
  const share = Math.min(Math.log1p(days * 24) / Math.log1p(24 * 365), 1);
  const saturation = share < 0.75 ? 72 : 72 - 240 * (share - 0.75);
  return `hsl(${160 + 190 * share} ${Math.round(saturation)}% ${dark ? 60 : 40}%)`;
}

export function drawGrid(context, view, colours) {
  const step = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((metres) => metres * view.scale >= 45) ?? 2000;
  const corners = [[0, 0], [view.width, 0], [0, view.height], [view.width, view.height]].map((one) => view.toMetre(...one));
  const xs = corners.map((one) => one[0]);
  const ys = corners.map((one) => one[1]);
  context.beginPath();
  for (let x = Math.floor(Math.min(...xs) / step) * step; x <= Math.max(...xs); x += step) {
    context.moveTo(x, Math.min(...ys));
    context.lineTo(x, Math.max(...ys));
  }
  for (let y = Math.floor(Math.min(...ys) / step) * step; y <= Math.max(...ys); y += step) {
    context.moveTo(Math.min(...xs), y);
    context.lineTo(Math.max(...xs), y);
  }
  context.strokeStyle = colours.line;
  context.globalAlpha = 0.55;
  context.lineWidth = 1 / view.scale;
  context.stroke();
  context.globalAlpha = 1;
  return step;
}

/** Lines through all maps: repeats thin, taught ones thick; cached as paths until a map changes. */
export function drawMaps(context, view, graph, colours, cache) {
  const maps = [...graph.maps].sort(([, a], [, b]) => b.about.generation - a.about.generation || a.about.stamp - b.about.stamp);
  context.lineJoin = "round";
  context.lineCap = "round";
  for (const [id, map] of maps) {
    const { path, dots } = pathOf(graph, id, map, cache);
    const taught = map.about.generation === 0;
    context.strokeStyle = ageColour(map.about.stamp, colours.dark);
    context.globalAlpha = taught ? 1 : 0.75;
    context.lineWidth = (taught ? 3.5 : 1.6) / view.scale;
    context.stroke(path);
    if (view.scale >= DOTS_FROM) {
      context.lineWidth = (taught ? 7 : 4.5) / view.scale;
      context.stroke(dots);
    }
  }
  context.globalAlpha = 1;
}

function pathOf(graph, id, map, cache) {
  const known = cache.get(id);
  if (known?.version === map.version) return known;
  const made = { version: map.version, path: new Path2D(), dots: new Path2D() };
  graph.each(id, (x, y, index) => {
    if (index === 0) made.path.moveTo(x, y);
    else made.path.lineTo(x, y);
    made.dots.moveTo(x, y);
    made.dots.lineTo(x, y + 1e-4);
  });
  cache.set(id, made);
  return made;
}

export function drawJoints(context, view, graph, colours) {
  context.strokeStyle = colours.soft;
  context.lineWidth = 1.5 / view.scale;
  context.setLineDash([4 / view.scale, 3 / view.scale]);
  context.beginPath();
  for (const [a, i, b, j] of graph.joints) {
    const [from, to] = [graph.at(a, i), graph.at(b, j)];
    if (from && to) {
      context.moveTo(...from);
      context.lineTo(...to);
    }
  }
  context.stroke();
  context.setLineDash([]);
}

/** A stretch of a map: closed ones red, limited ones amber. */
export function drawStretch(context, view, graph, stretch, colour, width = 9) {
  context.beginPath();
  let first = true;
  graph.each(stretch.map, (x, y) => {
    if (first) context.moveTo(x, y);
    else context.lineTo(x, y);
    if (first && stretch.first === stretch.last) context.lineTo(x + 1e-4, y);
    first = false;
  }, stretch.first, stretch.last);
  context.strokeStyle = colour;
  context.globalAlpha = 0.5;
  context.lineWidth = width / view.scale;
  context.stroke();
  context.globalAlpha = 1;
}

export function drawRoute(context, view, graph, route, colours) {
  context.beginPath();
  let first = true;
  for (const [map, from, to] of route.runs) {
    const step = to >= from ? 1 : -1;
    for (let index = from; step > 0 ? index <= to : index >= to; index += step) {
      const point = graph.at(map, index);
      if (!point) continue;
      if (first) context.moveTo(...point);
      else context.lineTo(...point);
      first = false;
    }
  }
  context.strokeStyle = colours.blue;
  context.globalAlpha = 0.35;
  context.lineWidth = 11 / view.scale;
  context.stroke();
  context.globalAlpha = 1;
}

// --- from here on in pixels ---------------------------------------------------------------------------------------

export function drawRobot(context, view, pose, colours, sure) {
  const [px, py] = view.toPixel(pose[0], pose[1]);
  context.save();
  context.translate(px, py);
  context.rotate(-(pose[2] + view.rotation));
  context.beginPath();
  context.moveTo(15, 0);
  context.lineTo(-9, 9);
  context.lineTo(-5, 0);
  context.lineTo(-9, -9);
  context.closePath();
  context.fillStyle = sure ? "#fbbf24" : colours.card;
  context.strokeStyle = colours.dark ? "#0b0f14" : "#3f2d00";
  context.lineWidth = 2;
  context.shadowColor = "rgb(0 0 0 / 35%)";
  context.shadowBlur = 6;
  context.fill();
  context.shadowBlur = 0;
  context.stroke();
  context.restore();
}

export function drawMark(context, view, point, colour, radius, filled = false) {
  const [px, py] = view.toPixel(...point);
  context.beginPath();
  context.arc(px, py, radius, 0, 7);
  context.lineWidth = 2.5;
  context.strokeStyle = colour;
  context.fillStyle = colour;
  if (filled) context.fill();
  else context.stroke();
}

export function drawLabel(context, view, point, text, colours, { flag = false, dy = -14 } = {}) {
  const [px, py] = view.toPixel(...point);
  context.font = "600 12px system-ui, sans-serif";
  const width = context.measureText(text).width + 12;
  context.fillStyle = flag ? colours.blue : colours.card;
  context.strokeStyle = flag ? colours.blue : colours.soft;
  context.lineWidth = 1;
  context.beginPath();
  context.roundRect(px - width / 2, py + dy - 10, width, 19, 6);
  context.fill();
  context.stroke();
  context.fillStyle = flag ? (colours.dark ? "#0b0f14" : "#ffffff") : colours.text;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, px, py + dy);
  context.textAlign = "start";
  context.textBaseline = "alphabetic";
}

export function drawScaleBar(context, view, colours, step) {
  const length = step * view.scale;
  const [x, y] = [12, view.height - 12];
  context.strokeStyle = colours.text;
  context.fillStyle = colours.text;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x, y);
  context.lineTo(x + length, y);
  context.lineTo(x + length, y - 5);
  context.stroke();
  context.font = "11px system-ui, sans-serif";
  context.fillText(`${step} m`, x + 4, y - 5);
}
