// What happened, the newest first.

import { brief, byId, make } from "/static/common/dom.js";

const MOST = 200;

export function startTimeline(link) {
  const list = byId("timeline");
  link.stream("events", (events, fresh) => {
    if (fresh) list.replaceChildren();
    for (const event of events) list.prepend(row(event));
    while (list.children.length > MOST) list.lastChild.remove();
  });
}

function row({ t, kind, text, bad }) {
  const time = new Date(t);
  return make("li", { class: bad ? "event bad" : "event", "data-kind": kind },
    make("time", { class: "figure soft", datetime: time.toISOString(), title: time.toLocaleString() }, time.toLocaleTimeString([], { hour12: false })),
    make("span", { class: "kind" }, kind), make("span", { class: "text", title: text }, brief(text)));
}
