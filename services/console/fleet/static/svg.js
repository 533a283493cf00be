// Drawings in SVG, coloured by CSS alone, so that light and dark need no second drawing.

const SPACE = "http://www.w3.org/2000/svg";

/** An SVG element: svg("path", { d, class: "a" }, child, …). */
export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SPACE, tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Calls `draw(width, height)` now, and whenever the element becomes wider or narrower, higher or lower. */
export function fitted(element, draw) {
  let before = "";
  new ResizeObserver(() => {
    const [width, height] = [Math.round(element.clientWidth), Math.round(element.clientHeight)];
    if (width && `${width} ${height}` !== before) {
      before = `${width} ${height}`;
      draw(width, height);
    }
  }).observe(element);
}

/** Round numbers between two values, about `count` of them. */
export function ticks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1);
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map((one) => one * power).find((one) => one >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return found;
}

/** A number without the noise of floating point, as short as its step allows. */
export function short(value) {
  return String(Number(value.toFixed(6)));
}

/** Places a label beside a point without leaving the drawing. */
export function anchored(x, width) {
  return x > width / 2 ? { x: x - 8, "text-anchor": "end" } : { x: x + 8, "text-anchor": "start" };
}
