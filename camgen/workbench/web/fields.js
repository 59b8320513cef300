// One setting as a field: its name, what is entered, its unit, a button to reset it, its sentence and its default.

import { apply, keep, make, same, set, toml, type } from "./talk.js";

/**
 * A field for the place `path`. Returned `show(own, usual)`: the value that the job has there, undefined for none, and what
 * holds without it.
 */
export function field(path, setting, { inRow = false } = {}) {
  const name = `f-${path.join("-")}`;
  const input = ENTRIES[setting.kind](setting);
  input.id = name;
  const slider = setting.kind === "number" && setting.minimum !== null && setting.maximum !== null && setting.maximum <= 360
    ? make("input", { type: "range", min: setting.minimum, max: setting.maximum, step: setting.maximum > 20 ? 1 : 0.01, tabIndex: -1 })
    : null;
  if (slider) slider.setAttribute("aria-label", `${setting.key}, as a slider`);
  const reset = make("button", {
    className: "reset small", type: "button", title: inRow ? "Remove it from this row" : "Back to the default",
    onclick: () => set(path, null),
  }, "\u21ba");
  const usually = make("p", { className: "usual" });
  const why = make("p", { className: "why", hidden: true });
  const element = make("div", { className: "field", data: { path: JSON.stringify(path), find: `${path.join(".")} ${setting.about}`.toLowerCase() } },
    make("div", { className: "line" },
      make("label", { htmlFor: name }, setting.key), input, make("span", { className: "unit" }, setting.unit), reset),
    slider && make("div", { className: "line" }, slider),
    make("p", { className: "about" }, setting.about), usually, why);
  if (setting.offers.length) {
    const offers = make("datalist", { id: `${name}-offers` }, ...setting.offers.map((one) => make("option", { value: one })));
    element.append(offers);
    input.setAttribute("list", offers.id);
  }
  input.addEventListener("change", () => { input.dataset.known = input.value; apply(changeOf(path, setting, input)); });
  if (input.type === "text") input.addEventListener("input", () => keep(isTyped(input) ? changeOf(path, setting, input) : { path }));
  if (setting.kind === "number") input.addEventListener("keydown", (event) => stepBy(event, path, setting, input));
  slider?.addEventListener("input", () => { input.value = slider.value; type(path, slider.value); });
  return {
    element, path, setting,
    show(own, usual, here) {
      // A default that is a number elsewhere is another number here; one that is not set is shown, and stays so.
      const other = here !== undefined && setting.default !== null && setting.kind !== "choice";
      const value = own !== undefined ? own : other ? here : usual;
      const changed = inRow ? own !== undefined : own !== undefined && !same(own, other ? here : setting.default);
      element.classList.toggle("changed", changed);
      // What somebody is typing stays.
      if (document.activeElement !== input || input.value === input.dataset.known) put(input, setting, value, here);
      if (slider && document.activeElement !== slider && typeof value === "number") slider.value = value;
      usually.textContent = tellUsual(setting, inRow ? usual : setting.default, inRow, here);
    },
    blame(line) {
      element.classList.toggle("wrong", Boolean(line));
      why.textContent = line || "";
      why.hidden = !line;
    },
  };
}

const ENTRIES = {
  flag: () => make("input", { type: "checkbox" }),
  choice: (setting) => make("select", {}, ...setting.choices.map((one) => make("option", { value: one }, one))),
  number: () => make("input", { type: "text", inputMode: "decimal", autocomplete: "off" }),
  text: () => make("input", { type: "text", autocomplete: "off", spellcheck: false }),
  free: () => make("input", { type: "text", autocomplete: "off", spellcheck: false }),
};

function put(input, setting, value, here) {
  enter(input, setting, value, here);
  input.dataset.known = input.value;
}

function enter(input, setting, value, here) {
  if (setting.kind === "flag") input.checked = value === true;
  else if (setting.kind === "choice") input.value = String(value);
  else if (value === null || value === undefined) { input.value = ""; input.placeholder = here === undefined || here === null ? "not set" : toml(here); }
  else input.value = setting.kind === "free" && typeof value !== "string" || typeof value === "object" ? toml(value) : String(value);
}

function changeOf(path, setting, input) {
  if (setting.kind === "flag") return { path, value: input.checked };
  if (setting.kind === "choice" || setting.kind === "text") return { path, value: input.value };
  return { path, raw: input.value };
}

/** Whether a field of the form holds a text that is not applied. */
export const isTyped = (input) => input.dataset?.known !== undefined && input.type === "text" && input.value !== input.dataset.known;

/** Applies what is being typed; the field keeps the focus. */
export function applyTyped() {
  const input = document.activeElement;
  if (input && isTyped(input)) input.dispatchEvent(new Event("change", { bubbles: true }));
}

/** Arrow keys step a number by 1, with shift by 10, with alt by 0.1. */
function stepBy(event, path, setting, input) {
  const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
  const now = Number(input.value);
  if (!way || input.value === "" || !Number.isFinite(now)) return;
  event.preventDefault();
  const next = Number((now + way * (event.shiftKey ? 10 : event.altKey ? 0.1 : 1)).toPrecision(12));
  if (next < (setting.minimum ?? -Infinity) || next > (setting.maximum ?? Infinity)) return;
  input.value = input.dataset.known = String(next);
  type(path, input.value);
}

function tellUsual(setting, value, inRow, here) {
  const plain = value === null || value === undefined ? "not set" : value === "" ? "empty" : toml(value);
  const told = here === undefined || here === null || same(here, value) ? plain
    : value === null || setting.kind === "choice" ? `${plain}, here ${toml(here)}` : `${toml(here)} here, else ${plain}`;
  const allowed = setting.allowed && !setting.allowed.startsWith("one of") ? `; ${setting.allowed}` : "";
  return `${inRow ? "without it" : "default"}: ${told}${allowed}`;
}
