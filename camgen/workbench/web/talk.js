// What this page asks of the workbench, one after the other, and small helpers that all files share.

let last = Promise.resolve();
//: What waits for its turn, in this order, and the newest text of each field that was typed and not yet sent.
const waiting = new Set(), typed = new Map();
//: A browser finishes requests of a page that is gone, up to 64 kB in all.
const MOST_KEPT = 30000;

/** Asks for a change; resolves to the answer, or to null after telling what is wrong with it. */
export function ask(path, body = {}) {
  const request = { path, body: JSON.stringify(body) };
  waiting.add(request);
  const answer = last.then(() => (waiting.delete(request) ? send(request) : null)).catch(() => null);
  // Save waits for a build, which may take minutes. What is changed meanwhile is kept at once.
  if (path !== "save") last = answer;
  return answer;
}

async function send({ path, body }) {
  const answer = await fetch(path, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body,
    keepalive: path !== "save" && body.length < MOST_KEPT,
  }).catch(() => refuse("error: the workbench did not answer: the last change is not kept"));
  if (!answer) return null;
  const said = await answer.json().catch(() => ({ line: "error: the workbench did not understand this page; reload it" }));
  if (answer.ok || said.edited) return said;
  return refuse(said.line);
}

function refuse(line) {
  document.dispatchEvent(new CustomEvent("refused", { detail: line }));
  return null;
}

/** Sets one place of the job: a value, or what was typed. */
export const set = (path, value) => apply({ path, value });
export const type = (path, raw) => apply({ path, raw });

/** Applies a change. What was typed at its place is no draft any more. */
export function apply(change) {
  typed.delete(JSON.stringify(change.path));
  return ask("change", { changes: [change] });
}

/** Keeps what is typed in a field before it is applied; without a value and a text it was taken back. */
export function keep(change) {
  const place = JSON.stringify(change.path);
  const isWaiting = typed.has(place);
  typed.set(place, change);
  if (!isWaiting) last = last.then(() => typed.has(place) && send(draftOf(place))).catch(() => null);
}

function draftOf(place) {
  const body = JSON.stringify(typed.get(place));
  typed.delete(place);
  return { path: "draft", body };
}

/** Sends all that waits, when the page may not live for its turn. */
function flush(isGone) {
  const requests = [...typed.keys()].map(draftOf);
  if (isGone) requests.unshift(...[...waiting].filter(({ path }) => path !== "save"));
  if (isGone) waiting.clear();
  for (const { path, body } of requests) navigator.sendBeacon(path, new Blob([body], { type: "application/json" }));
}

addEventListener("pagehide", () => flush(true));
document.addEventListener("visibilitychange", () => document.hidden && flush(false));

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
