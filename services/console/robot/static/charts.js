// Path error, inliers and metres since the last success, over the last two minutes.

import { byId, fixed, make, say } from "/static/common/dom.js";

const SECONDS = 120;
const GAP_S = 1;
const CHARTS = [
  { name: "Path error", unit: "m", column: 1, colour: "--blue", symmetric: true, least: 0.1, text: (v) => `${fixed(v, 2)} m` },
  { name: "Inliers", unit: "", column: 2, colour: "--accent", least: 50, text: (v) => `${v}` },
  { name: "Since localized", unit: "m", column: 3, colour: "--warn", least: 1, text: (v) => `${v.toFixed(1)} m` },
];

export function startCharts(link, clock) {
  let samples = [];
  const charts = CHARTS.map((chart) => build(chart));
  link.stream("series", (values, fresh) => {
    samples = fresh ? values : samples.concat(values);
    const now = samples.at(-1)?.[0] ?? 0;
    while (samples.length && samples[0][0] < now - SECONDS) samples.shift();
  });
  const draw = () => {
    const now = clock.now() ?? samples.at(-1)?.[0] ?? 0;
    charts.forEach((chart) => paint(chart, samples, now));
  };
  setInterval(() => { if (!document.hidden) draw(); }, 200);
  window.addEventListener("theme", draw);
}

function build(chart) {
  const canvas = make("canvas", { role: "img", "aria-label": `${chart.name} over time` });
  const value = make("span", { class: "figure" }, "—");
  byId("charts").append(make("figure", {}, make("figcaption", {}, chart.name, " ", value), canvas));
  return { ...chart, canvas, value };
}

function paint(chart, samples, now) {
  const { canvas } = chart;
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  const known = samples.filter((sample) => sample[chart.column] !== null && sample[0] >= now - SECONDS);
  const most = known.reduce((top, sample) => Math.max(top, Math.abs(sample[chart.column])), chart.least) * 1.1;
  const least = chart.symmetric ? -most : 0;
  const y = (value) => height - 3 - ((value - least) / (most - least)) * (height - 6);
  const x = (time) => width - ((now - time) / SECONDS) * width;
  grid(context, style, width, height, chart, { most, least, y });
  line(context, style.getPropertyValue(chart.colour), known, chart.column, x, y);
  const last = known.at(-1);
  say(chart.value, last && now - last[0] < 2 ? chart.text(last[chart.column]) : "—");
}

function grid(context, style, width, height, chart, { most, y }) {
  context.strokeStyle = style.getPropertyValue("--line");
  context.fillStyle = style.getPropertyValue("--soft");
  context.font = "10px system-ui, sans-serif";
  context.lineWidth = 1;
  for (const value of chart.symmetric ? [most / 1.1, 0, -most / 1.1] : [most / 1.1, 0]) {
    context.beginPath();
    context.moveTo(0, Math.round(y(value)) + 0.5);
    context.lineTo(width, Math.round(y(value)) + 0.5);
    context.stroke();
    const text = Math.abs(value) >= 10 || value === 0 ? Math.round(value) : Math.abs(value) >= 1 ? value.toFixed(1) : value.toFixed(2);
    context.fillText(`${text}${chart.unit && ` ${chart.unit}`}`, 2, Math.min(Math.max(y(value) - 3, 10), height - 3));
  }
}

function line(context, colour, samples, column, x, y) {
  context.strokeStyle = colour;
  context.lineWidth = 1.75;
  context.lineJoin = "round";
  context.beginPath();
  samples.forEach((sample, index) => {
    const joined = index > 0 && sample[0] - samples[index - 1][0] < GAP_S;
    if (joined) context.lineTo(x(sample[0]), y(sample[column]));
    else context.moveTo(x(sample[0]), y(sample[column]));
  });
  context.stroke();
}
