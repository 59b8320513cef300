// What this page asks of the workbench, and small helpers that all files share.

/**
 * Asks for a change. The page waits for the answer, which takes some milliseconds: what it shows from then on is on the
 * disk, whatever ends this tab next. Returns the answer, or null after telling what is wrong with it.
 */
export function ask(path, body = {}) {
  const request = new XMLHttpRequest();
  request.open("POST", path, false);
  request.setRequestHeader("Content-Type", "application/json");
  try {
    request.send(JSON.stringify(body));
  } catch {
    return refuse("error: the workbench did not answer: the last change is not kept");
  }
  return read(request.status, request.responseText);
}

/** Asks for a save, which waits for a build and may take minutes. */
export async function askSave(body) {
  const answer = await fetch("save", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) }).catch(() => null);
  return answer ? read(answer.status, await answer.text()) : refuse("error: the workbench did not answer: nothing is saved");
}

function read(status, text) {
  let said = { line: "error: the workbench did not understand this page; reload it" };
  try { said = JSON.parse(text); } catch { /* the line above says it */ }
  return status === 200 || said.edited ? said : refuse(said.line);
}

function refuse(line) {
  document.dispatchEvent(new CustomEvent("refused", { detail: line }));
  return null;
}

/** Applies a change of one place of the job: a value, or what was typed. */
export const apply = (change) => ask("change", { changes: [change] });
export const set = (path, value) => apply({ path, value });
export const type = (path, raw) => apply({ path, raw });

/** Keeps what is typed in a field before it is applied; without a value and a text it was taken back. */
export const keep = (change) => ask("draft", change);

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
