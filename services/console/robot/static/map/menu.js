// What can be done with a vertex that was chosen on the map.

import { byId, make } from "/static/common/dom.js";
import { place, teach } from "../commands.js";
import { shortName } from "../graph.js";

export class Menu {
  constructor(link, frame, commands, graph, stretch) {
    Object.assign(this, { link, frame, commands, graph, stretch, chosen: null });
    this.box = byId("menu");
    this.box.addEventListener("keydown", (event) => {
      if (event.key === "Escape") {
        event.stopPropagation();
        this.close();
        byId("map").focus();
      }
    });
  }

  close() {
    this.commands.release(this.box.querySelectorAll("button"));
    this.box.hidden = true;
    this.chosen = null;
  }

  /** Opens for a vertex { map, index } near a pixel. */
  open(vertex, px, py, byKeyboard) {
    this.close();
    this.chosen = vertex;
    const text = `${vertex.map}:${vertex.index}`;
    const name = this.graph.nameOf(vertex.map, vertex.index);
    const about = this.graph.maps.get(vertex.map)?.about;
    const goal = { goal: { to: name ?? text } };
    const taught = about?.generation === 0;
    const head = make("p", { class: "menu-head" }, make("b", {}, name ?? `vertex ${vertex.index}`),
      make("span", { class: "soft small" }, shortName(vertex.map, about)));
    const items = [head];
    if (taught) {
      const busy = this.commands.why("append") === "";
      items.push(busy
        ? this.#item("Drive here instead", "swap", () => this.frame.act("swap", goal))
        : this.#item("Drive here", "repeat", () => this.frame.act("repeat", goal)));
      if (busy) items.push(this.#item("Add to the goals", "append", () => this.frame.act("append", goal)));
      items.push(this.#item("Teach from here…", "teach", () => teach(this.frame, text)));
    }
    items.push(
      this.#item("The robot is here", "position", () => this.frame.act("position", { vertex: text })),
      this.#item("Merge here", "merge", () => this.frame.act("merge", { vertex: text })),
      this.#item("Name this place…", "name_place", () => this.#name(text, name)),
      this.#item("Mark a stretch from here", "restrict", () => this.stretch.begin(vertex)),
    );
    const marked = this.graph.restrictions.find((one) => one.map === vertex.map && one.first <= vertex.index && vertex.index <= one.last);
    if (marked) items.push(this.#item(`Lift the ${marked.speed ? "limit" : "closure"} here`, "restrict", () => this.stretch.lift(marked)));
    this.box.replaceChildren(...items);
    this.#show(px, py);
    if (byKeyboard) this.box.querySelector("button").focus();
  }

  #item(label, command, act) {
    const button = make("button", { type: "button", role: "menuitem", class: "quiet" }, label);
    this.commands.bind(button, command, () => {
      this.close();
      act();
    });
    return button;
  }

  #show(px, py) {
    this.box.hidden = false;
    const holder = this.box.parentElement;
    const left = Math.min(px + 12, holder.clientWidth - this.box.offsetWidth - 6);
    const top = Math.min(py + 12, holder.clientHeight - this.box.offsetHeight - 6);
    this.box.style.left = `${Math.max(left, 6)}px`;
    this.box.style.top = `${Math.max(top, 6)}px`;
  }

  async #name(vertex, name) {
    const wanted = await this.frame.ask("Name this place", [{ ...place("place", "Name", name ?? ""), required: true }], "Name it",
      "A name that another place has moves here.");
    if (wanted) this.frame.act("name_place", { place: wanted.place, vertex });
  }
}
