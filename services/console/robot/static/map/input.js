// Pointers, wheel and keys on the map: one finger moves, two scale and turn, a tap chooses.

const TAP_PIXELS = 6;

/**
 * `on` has pan(dx, dy), zoom(factor, x, y, turn), tap(x, y), hover(x, y), key(event): in pixels of the canvas;
 * key returns whether it has taken the key.
 */
export function listen(canvas, on) {
  const pointers = new Map();
  let moved = 0;

  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (pointers.size === 0) moved = 0;
    pointers.set(event.pointerId, at(event));
  });

  canvas.addEventListener("pointermove", (event) => {
    const now = at(event);
    const before = pointers.get(event.pointerId);
    if (!before) return on.hover(...now);
    const step = [now[0] - before[0], now[1] - before[1]];
    moved += Math.hypot(...step);
    if (pointers.size === 1) {
      if (event.shiftKey) on.zoom(1, canvas.clientWidth / 2, canvas.clientHeight / 2, -step[0] / 150);
      else if (moved > TAP_PIXELS) on.pan(...step);
    } else if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      pinch(on, before, now, other);
    }
    pointers.set(event.pointerId, now);
    return undefined;
  });

  const up = (event) => {
    const known = pointers.delete(event.pointerId);
    if (known && event.type === "pointerup" && moved <= TAP_PIXELS && pointers.size === 0) on.tap(...at(event));
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("pointerleave", () => on.hover(null, null));

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const [x, y] = at(event);
    if (event.shiftKey) on.zoom(1, x, y, (event.deltaY || event.deltaX) / 600);
    else on.zoom(Math.exp(-event.deltaY / 500), x, y, 0);
  }, { passive: false });

  canvas.addEventListener("keydown", (event) => {
    if (!event.ctrlKey && !event.metaKey && !event.altKey && on.key(event)) event.preventDefault();
  });
}

function pinch(on, before, now, other) {
  const a = [before[0] - other[0], before[1] - other[1]];
  const b = [now[0] - other[0], now[1] - other[1]];
  const [la, lb] = [Math.hypot(...a), Math.hypot(...b)];
  if (la < 1 || lb < 1) return;
  const turn = Math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
  on.zoom(lb / la, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2, -turn);
}
