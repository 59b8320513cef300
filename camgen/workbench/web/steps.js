// Operations and tools as lists: each row with what it sets, a menu of what it may set, and its place.

import { field } from "./fields.js";
import { ask, counted, draggable, make, move, set, toml } from "./talk.js";

const home = document.getElementById("steps");
const opened = new Set();
let shown = "", current = null;
export const rowFields = new Map();

/** The rows of a table as they are now, not as they were when a button was made. */
const rowsOf = (table) => current.tables[table] ?? [];

export function showSteps(state, form) {
  current = state;
  // A field in which somebody types is not taken away.
  if (home.contains(document.activeElement) && document.activeElement.matches("input[type=text]")) return update(state, form);
  const now = JSON.stringify([state.tables, state.looked.worked, state.looked.kind, state.post]);
  if (now === shown) return update(state, form);
  const focused = document.activeElement?.id;
  shown = now;
  rowFields.clear();
  const operations = state.tables.operations ?? [], tools = state.tables.tools ?? [];
  home.replaceChildren(
    make("h2", {}, "Operations"),
    make("p", { className: "hint" }, operations.length
      ? "Holes run before pockets before profiles, with few tool changes; with tour.method = \"as-drawn\" they run as listed."
      : "The job has one operation: [operation] in the settings, on all that is read."),
    ...operations.map((row, place) => card(state, form, "operations", row, place)),
    make("div", { className: "bar" },
      make("button", { onclick: addOperation }, "Add operation"),
      make("button", { title: "Tools and operations for the closed contours", hidden: state.looked.kind !== "drawing", onclick: () => ask("propose") }, "Propose operations")),
    make("h2", {}, "Tools"),
    make("p", { className: "hint" }, tools.length ? "Operations name them." : "Without rows here all operations use [tool] of the settings."),
    ...tools.map((row, place) => card(state, form, "tools", row, place)),
    make("div", { className: "bar" },
      make("button", { onclick: () => set(["tools"], [...rowsOf("tools"), { name: `tool ${rowsOf("tools").length + 1}` }]) }, "Add tool")));
  if (focused) document.getElementById(focused)?.focus();
}

function addOperation() {
  const [tool] = rowsOf("tools");
  set(["operations"], [...rowsOf("operations"), tool ? { tool: tool.name || tool.number } : {}]);
}

function update(state) {
  for (const one of rowFields.values()) {
    const [table, place, key] = one.path;
    const row = state.tables[table]?.[place];
    if (row) one.show(row[key], usual(state, one.overridden, one.setting, row));
  }
}

function card(state, form, table, row, place) {
  const moved = (from, to) => { const found = move(rowsOf(table), from, to); if (found) set([table], found); };
  const element = make("div", { className: "row", data: { row: `${table}.${place}` } });
  const groups = form.rows[table];
  const kept = groups.flatMap((group) => group.fields.filter((setting) => setting.key in row).map((setting) => [group, setting]));
  const body = make("div", { hidden: !opened.has(`${table}.${place}`) }, ...kept.map(([group, setting]) => rowField(state, table, place, row, group, setting)), menu(state, table, row, place, groups));
  const toggle = make("button", {
    className: "small", title: "Its settings", onclick: () => {
      body.hidden = !body.hidden;
      opened[body.hidden ? "delete" : "add"](`${table}.${place}`);
    },
  }, "Edit");
  element.append(
    make("div", { className: "line" }, draggable(element, place, table, moved), make("span", {}, title(state, table, row, place)), toggle,
      make("button", { className: "small", title: "Twice", onclick: () => copy(table, place) }, "Copy"),
      make("button", { className: "small", title: "Remove", onclick: () => set([table], rowsOf(table).length > 1 ? rowsOf(table).toSpliced(place, 1) : null) }, "Remove")),
    make("p", { className: "hint" }, facts(state, table, row, place)), body);
  return element;
}

function copy(table, place) {
  const row = rowsOf(table)[place];
  const twin = table === "tools" ? { ...row, name: `${row.name ?? "tool"} copy` } : row;
  set([table], rowsOf(table).toSpliced(place + 1, 0, twin));
}

function title(state, table, row, place) {
  if (table === "tools") return `${row.name || `T${row.number ?? place}`}: ${row.kind ?? "end mill"} ${row.diameter ?? 6} mm`;
  const tool = toolOf(state, row);
  return `${place} ${row.kind ?? state.tables.operation?.kind ?? "auto"}${tool ? `, ${tool.name || `T${tool.number}`}` : ""}`;
}

function facts(state, table, row, place) {
  const set = Object.entries(row).filter(([key]) => !["name", "kind", "tool", "ids"].includes(key)).map(([key, value]) => `${key} ${toml(value)}`);
  const worked = table === "operations" ? state.looked.worked[place] : undefined;
  return [worked ? `works on ${counted(worked.length, "contour")}` : "", ...set].filter(Boolean).join(", ");
}

function rowField(state, table, place, row, group, setting) {
  const made = field([table, place, setting.key], setting, { inRow: true });
  made.overridden = group.overridden;
  made.show(row[setting.key], usual(state, group.overridden, setting, row));
  rowFields.set(JSON.stringify(made.path), made);
  return made.element;
}

const toolOf = (state, row) => (state.tables.tools ?? []).find((one) => row.tool && (one.name === row.tool || one.number === row.tool));

/** What holds where the row is silent. */
function usual(state, over, setting, row) {
  const tool = toolOf(state, row);
  const fromTool = { feed: tool?.feed, plunge: tool?.plunge, spindle: tool?.speed }[setting.key];
  return fromTool ?? state.tables[over === "tool" ? "" : over]?.[setting.key] ?? (setting.default === null ? null : elsewhere(state, over, setting)) ?? setting.default;
}

/** A default that hangs on the rest of the job. */
const elsewhere = (state, over, setting) => (setting.kind === "number" ? state.usual[over]?.[setting.key] : undefined);

function menu(state, table, row, place, groups) {
  const options = groups.map((group) => make("optgroup", { label: group.overridden ? `[${group.overridden}]` : `[[${table}]]` },
    ...group.fields.filter((setting) => !(setting.key in row)).map((setting) => make("option", { value: setting.key, title: setting.about }, `${setting.key}: ${setting.about}`))));
  return make("select", {
    className: "more", ariaLabel: "Set another key in this row",
    onchange: (event) => {
      const group = groups.find((one) => one.fields.some((setting) => setting.key === event.target.value));
      const setting = group.fields.find((one) => one.key === event.target.value);
      const value = usual(state, group.overridden, setting, row);
      opened.add(`${table}.${place}`);
      set([table, place, setting.key], value ?? START[setting.kind] ?? "");
    },
  }, make("option", { value: "" }, "Set another key ..."), ...options);
}

//: What a key that is not set by default begins with, for the user to change.
const START = { number: 1, flag: true, free: [], text: "" };

/** Opens the row that an error is about. */
export function revealRow([table, place, key]) {
  const element = home.querySelector(`[data-row="${table}.${place}"]`);
  if (!element) return false;
  opened.add(`${table}.${place}`);
  element.lastElementChild.hidden = false;
  element.scrollIntoView({ block: "center" });
  rowFields.get(JSON.stringify([table, place, key]))?.element.querySelector("input, select").focus();
  return true;
}

