// The keys of the workbench, and its help. They work wherever the focus is: in the form, the lists and the picture.

import { isTyped } from "./fields.js";
import { make } from "./talk.js";

const HELP = document.getElementById("keys");
//: Each with the names of its keys, what it does, and its name for those who do it.
export const KEYS = [
  [["Ctrl-S"], "save the job file and the program", "save"],
  [["Ctrl-Z"], "undo the last change", "undo"],
  [["Ctrl-Shift-Z", "Ctrl-Y"], "redo what was undone", "redo"],
  [["F1", "?"], "show these keys, or close them", "help"],
];
const NAMES = new Map(KEYS.flatMap(([keys, , name]) => keys.map((key) => [key, name])));
const OWN_HISTORY = ["undo", "redo"];
const actions = { help: () => (HELP.open ? HELP.close() : openHelp()) };
let picture = () => null;

/** What the keys do, by their names; `shown` gives the window of the picture, null while there is none. */
export function useKeys(found, shown) {
  Object.assign(actions, found);
  picture = shown;
  listen(window);
}

/** Hears the keys of a window: this one, and that of each picture. */
export const listen = (window) => window.addEventListener("keydown", press, true);

function press(event) {
  const name = NAMES.get(nameOf(event));
  const isPlain = !event.ctrlKey && !event.metaKey && !event.altKey;
  if (!name) {
    if (isPlain && event.view === window && !HELP.open && !takes(event.target, event.key)) hand(event);
    return;
  }
  // A character that is typed, and the history of a text that is not applied, are those of the field.
  if (isPlain && event.key.length === 1 && isText(event.target)) return;
  if (OWN_HISTORY.includes(name) && hasHistory(event.target)) return;
  event.preventDefault();
  event.stopPropagation();
  if (name === "help" || !HELP.open) actions[name]();
}

function nameOf({ key, ctrlKey, metaKey, altKey, shiftKey }) {
  if (altKey) return "";
  if (!ctrlKey && !metaKey) return key;
  return `Ctrl-${shiftKey ? "Shift-" : ""}${key.length === 1 ? key.toUpperCase() : key}`;
}

const isText = (target) => Boolean(target.matches?.("input:not([type=checkbox], [type=range]), textarea"));
const hasHistory = (target) => isText(target) && (target.type === "search" ? target.value !== "" : isTyped(target));

/** Whether an element of the form has its own use for a key. */
function takes(target, key) {
  if (!target.matches) return false;
  if (isText(target) || target.matches("select, [type=range]")) return true;
  return key === " " && target.matches("input, button, summary");
}

/** Gives a key that the form does not use to the picture. */
function hand(event) {
  const { key, shiftKey } = event;
  const isUnused = picture()?.dispatchEvent(new KeyboardEvent("keydown", { key, shiftKey, bubbles: true, cancelable: true })) ?? true;
  if (!isUnused) event.preventDefault();
}

// The help.

const rows = (list) => make("div", { className: "keys" }, ...list.flatMap(([keys, text]) => [make("kbd", {}, [keys].flat().join(", ")), make("span", {}, text)]));

function openHelp() {
  HELP.replaceChildren(
    make("h2", {}, "Everywhere: form, lists and picture"), rows(KEYS),
    make("p", { className: "hint" }, "While a text is typed in a field, undo and redo are those of that text. Enter or another place applies it: from then on they are the workbench's. A question mark is a character there."),
    make("h2", {}, "The picture, from everywhere"), rows((picture()?.camgen?.keys ?? []).filter(([key]) => !NAMES.has(key))),
    make("p", { className: "hint" }, "An element with its own use of a key keeps it: a field, a menu, and a button for the space bar."),
    make("button", { onclick: () => HELP.close() }, "Close"));
  HELP.showModal();
}

document.getElementById("help").addEventListener("click", actions.help);
