// What this page asks of the workbench, one after the other, and small helpers that all files share.

let last = Promise.resolve();

/** Asks for a change; resolves to the answer, or to null after telling what is wrong with it. */
export function ask(path, body = {}) {
  last = last.then(() => send(path, body)).catch(() => null);
  return last;
}

async function send(path, body) {
  const answer = await fetch(path, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(body),
  });
  const said = await answer.json().catch(() => ({ line: "error: the workbench did not understand this page; reload it" }));
  if (answer.ok) return said;
  document.dispatchEvent(new CustomEvent("refused", { detail: said.line }));
  return null;
}

/** Sets one place of the job: a value, or what was typed. */
export const set = (path, value) => ask("change", { changes: [{ path, value }] });
export const type = (path, raw) => ask("change", { changes: [{ path, raw }] });

/** An element with properties and children; what is text stays text. */
export function make(name, properties = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "data") Object.assign(element.dataset, value);
    else if (key in element) element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** A value as TOML. */
export function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (value !== null && typeof value === "object") {
    return `{ ${Object.entries(value).map(([key, own]) => `${/^[\w-]+$/.test(key) ? key : JSON.stringify(key)} = ${toml(own)}`).join(", ")} }`;
  }
  return JSON.stringify(value);
}

export const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** Counts a noun. */
export const counted = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;

/** Lets the elements of a list be dragged to another place: `moved` gets both places. Alt and arrow keys do it too. */
export function draggable(element, place, kind, moved) {
  const grip = make("span", { className: "grip", title: "Drag, or Alt and arrow keys", tabIndex: 0 }, "\u2630");
  grip.setAttribute("role", "button");
  grip.setAttribute("aria-label", `Move, now at place ${place + 1}`);
  grip.addEventListener("pointerdown", () => (element.draggable = true));
  grip.addEventListener("pointerup", () => (element.draggable = false));
  grip.addEventListener("keydown", (event) => {
    const way = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!way || !event.altKey) return;
    event.preventDefault();
    moved(place, place + way);
  });
  element.addEventListener("dragstart", (event) => {
    event.dataTransfer.setData(`text/x-${kind}`, String(place));
    event.dataTransfer.effectAllowed = "move";
  });
  element.addEventListener("dragend", () => (element.draggable = false));
  element.addEventListener("dragover", (event) => {
    if (!event.dataTransfer.types.includes(`text/x-${kind}`)) return;
    event.preventDefault();
    element.classList.add("over");
  });
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    element.classList.remove("over");
    const from = Number(event.dataTransfer.getData(`text/x-${kind}`));
    if (from !== place) moved(from, place);
  });
  return grip;
}

/** `list` with one element at another place; null where there is no such place. */
export function move(list, from, to) {
  if (to < 0 || to >= list.length) return null;
  const found = [...list];
  found.splice(to, 0, ...found.splice(from, 1));
  return found;
}
