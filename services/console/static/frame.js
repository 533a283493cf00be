// The frame around every page: connection, Stop, theme, messages and questions.

import { brief, byId, make, say } from "/static/common/dom.js";
import { Link } from "/static/common/link.js";

const TOAST_MS = 6000;
const AGAIN_MS = 1000;

class Frame {
  constructor(link) {
    this.link = link;
    this.#theme();
    this.#state();
    this.#stop();
  }

  /** Tells the operator something for a while; `bad` for what failed. */
  toast(text, bad = false) {
    const box = make("div", { class: bad ? "toast bad" : "toast" }, brief(text));
    byId("toasts").append(box);
    setTimeout(() => box.remove(), bad ? 2 * TOAST_MS : TOAST_MS);
  }

  /** Has the service do something and tells what came of it; returns that, or undefined where it failed. */
  async act(action, args = {}) {
    try {
      const told = await this.link.do(action, args);
      if (typeof told === "string" && told) this.toast(told);
      return told;
    } catch (error) {
      this.toast(error.message, true);
      return undefined;
    }
  }

  /**
   * Asks for values: ask("Title", [{name, label, value, type, options, required, pattern, hint}], "Do it").
   * The promise gives {name: value}, or null where the operator thinks better of it.
   */
  ask(title, fields, yes, text = "") {
    const dialog = byId("dialog");
    const inputs = fields.map((field) => [field, input(field)]);
    const form = make("form", { method: "dialog" },
      make("h3", {}, title), text && make("p", { class: "soft" }, text),
      ...inputs.map(([field, element]) => make("label", { class: field.type === "checkbox" ? "check" : null },
        ...(field.type === "checkbox" ? [element, field.label] : [field.label, element]))),
      make("div", { class: "row" },
        make("button", { type: "button", onclick: () => dialog.close("") }, "Not now"),
        make("button", { type: "submit", class: "primary", value: "yes" }, yes)));
    dialog.replaceChildren(form);
    dialog.returnValue = "";
    dialog.showModal();
    return new Promise((resolve) => {
      dialog.addEventListener("close", () => resolve(dialog.returnValue !== "yes" ? null : Object.fromEntries(
        inputs.map(([field, element]) => [field.name, field.type === "checkbox" ? element.checked : element.value])),
      ), { once: true });
    });
  }

  #theme() {
    byId("theme").onclick = () => {
      const root = document.documentElement;
      root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
      localStorage.setItem("theme", root.dataset.theme);
      window.dispatchEvent(new Event("theme"));
    };
  }

  #state() {
    const pill = byId("link");
    const show = (text, kind) => {
      say(pill, text);
      pill.className = `pill ${kind}`;
      document.body.classList.toggle("away", kind === "bad");
    };
    this.link.addEventListener("all", () => show("live", "good"));
    this.link.addEventListener("lost", () => show("reconnecting", "bad"));
  }

  #stop() {
    const stop = byId("stop");
    if (!stop) return;
    const send = async (what) => {
      try {
        const answer = await fetch(`/${what}`, { method: "POST" });
        const { told } = await answer.json();
        this.toast(told, !answer.ok);
      } catch {
        this.toast("The stop did not reach the console: use the robot's own button.", true);
      }
    };
    stop.onclick = () => send("stop");
    byId("reset").onclick = () => send("reset");
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !byId("dialog").open) send("stop");
    });
  }

  /** Shows whether the emergency stop is latched. */
  latched(is) {
    byId("stop")?.classList.toggle("latched", is);
    if (byId("reset")) byId("reset").hidden = !is;
  }
}

function input(field) {
  if (field.options) {
    return make("select", { name: field.name },
      ...field.options.map(([value, label]) => make("option", { value, selected: value === field.value }, label)));
  }
  if (field.type === "checkbox") return make("input", { type: "checkbox", checked: field.value });
  return make("input", {
    name: field.name, type: field.type ?? "text", value: field.value ?? "", required: field.required,
    pattern: field.pattern, title: field.hint, placeholder: field.placeholder, min: field.min, max: field.max,
    step: field.step, autocomplete: "off",
  });
}

/** The page's own module; a console that goes while it is fetched has the whole page loaded anew once it is back. */
async function load(page) {
  const file = `/static/${page}/page.js`;
  try {
    return await import(file);
  } catch (error) {
    console.error(error);
    for (;;) {
      await new Promise((resolve) => { setTimeout(resolve, AGAIN_MS); });
      const answer = await fetch(file, { cache: "no-store" }).catch(() => null);
      if (answer?.ok) location.reload();
    }
  }
}

const page = document.body.dataset.page;
const link = new Link(page);
const frame = new Frame(link);
globalThis.vtrLink = link; // for tests, and for whoever writes a script
(await load(page)).start(link, frame);
