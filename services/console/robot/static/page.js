// The robot's page: each part takes what it shows from the link, and asks by the frame.

import { startCamera } from "./camera.js";
import { startCharts } from "./charts.js";
import { Clock } from "./clock.js";
import { startCommands } from "./commands.js";
import { startGoals } from "./goals.js";
import { Graph } from "./graph.js";
import { startHealth } from "./health.js";
import { startMap } from "./map/map.js";
import { startStatus } from "./status.js";
import { startTeleop } from "./teleop.js";
import { startTimeline } from "./timeline.js";

export function start(link, frame) {
  const clock = new Clock(link);
  const graph = new Graph(link);
  const commands = startCommands(link, frame);
  startStatus(link, frame, clock);
  startGoals(link, frame, commands, graph);
  startMap(link, frame, commands, graph, clock);
  startCamera(link);
  startCharts(link, clock);
  startHealth(link, clock);
  startTeleop(link, frame);
  startTimeline(link);
}
