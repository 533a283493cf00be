// Elements in one line.

/** An element: make("li", { class: "a", onclick: f }, "text", child, …). */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const byId = (id) => document.getElementById(id);

/** Sets text only where it differs, so that nothing is laid out or read aloud in vain. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** A number with so many digits behind the point, and no sign where that leaves nothing. */
export function fixed(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text;
}

/** A text with its maps' long ids made short: the last part alone tells maps apart for a person. */
export const brief = (text) => text.replace(/\d{8}T\d{12}-[a-z0-9_-]+?-([0-9a-f]{6})(?=[^0-9a-f]|$)/g, "$1");

/** Enables a button, or has it say why it cannot act: it stays reachable by keyboard, and its reason by all. */
export function able(button, why) {
  const disabled = why ? "true" : "false";
  if (button.getAttribute("aria-disabled") !== disabled) button.setAttribute("aria-disabled", disabled);
  if (button.title !== (why ?? "")) button.title = why ?? "";
}
