// What the camera sees, the features that were matched in it, and which stream localized.

import { byId, make, say } from "/static/common/dom.js";

const GONE_MS = 2000;

export function startCamera(link) {
  const canvas = byId("camera");
  const context = canvas.getContext("2d");
  let last = 0;
  link.picture("camera", async (header, blob) => {
    const image = await createImageBitmap(blob);
    last = performance.now();
    byId("camera-none").hidden = true;
    if (canvas.width !== header.width || canvas.height !== header.height) {
      canvas.width = header.width;
      canvas.height = header.height;
    }
    context.drawImage(image, 0, 0);
    image.close();
    dots(context, header);
    canvas.dataset.features = header.points.length / 2;
  });
  setInterval(() => { byId("camera-none").hidden = performance.now() - last < GONE_MS; }, 500);
  link.on("live", (live) => facts(live ?? {}));
}

function dots(context, { points, success, stream }) {
  const colour = success ? (stream === "invariant" ? "#c084fc" : "#34d399") : "#f87171";
  context.lineWidth = 1.5;
  context.strokeStyle = "rgb(0 0 0 / 55%)";
  context.fillStyle = colour;
  for (let index = 0; index < points.length; index += 2) {
    context.beginPath();
    context.arc(points[index], points[index + 1], 3, 0, 7);
    context.stroke();
    context.fill();
  }
}

let shown = "";
function facts(live) {
  const streams = Object.entries(live.streams ?? {});
  const text = JSON.stringify([streams, live.stream, live.success, live.inliers ?? live.tracked]);
  if (text === shown) return;
  shown = text;
  const pills = streams.map(([name, success]) => make("span", {
    class: `pill ${success ? "good" : "bad"}`,
    title: success ? `localized by the ${name} images` : `the ${name} images did not localize`,
  }, name === live.stream && live.success ? `● ${name}` : name));
  const count = make("span", { class: "soft small figure" });
  say(count, live.inliers !== undefined ? `${live.inliers} matched` : live.tracked !== undefined ? `${live.tracked} tracked` : "");
  byId("camera-facts").replaceChildren(...pills, count);
}
