// The settings of the job, a group for each of its tables.

import { field } from "./fields.js";
import { counted, make, same } from "./talk.js";

//: The groups that are open at first, by what the input is.
const OPEN = {
  drawing: ["operation", "tool", "process"], picture: ["image", "operation", "tool", "page"],
  solid: ["input", "operation", "tool", "cell"], curves: ["operation", "tool", "cell"], program: ["operation", "post"],
};
const home = document.getElementById("groups");
const filter = document.getElementById("filter");
const only = document.getElementById("only");
let groups = [];

export const fields = new Map();

/** Makes the form anew: once, and when another controller brings other options. */
export function buildSettings(form) {
  const open = new Set(groups.filter((group) => group.element.open).map((group) => group.table));
  fields.clear();
  groups = form.groups.map((group) => {
    const made = group.fields.map((setting) => field([group.table, setting.key], setting));
    for (const one of made) fields.set(JSON.stringify(one.path), one);
    const count = make("b");
    const element = make("details", { open: open.has(group.table), data: { table: group.table } },
      make("summary", {}, `[${group.table}]`, make("small", {}, group.about.replace(/\.$/, "")), count),
      ...made.map((one) => one.element));
    return { table: group.table, made, count, element };
  });
  home.replaceChildren(...groups.map((group) => group.element));
}

/** Opens what is usually set for such an input. */
export function openUsual(kind) {
  for (const group of groups) if ((OPEN[kind] ?? OPEN.drawing).includes(group.table)) group.element.open = true;
}

export function showSettings(state) {
  for (const group of groups) {
    const own = state.tables[group.table] ?? {}, usual = state.usual[group.table] ?? {};
    for (const one of group.made) one.show(own[one.setting.key], one.setting.default, usual[one.setting.key]);
    const changed = group.made.filter((one) => own[one.setting.key] !== undefined && !same(own[one.setting.key], one.setting.default));
    group.count.textContent = changed.length ? counted(changed.length, "change") : "";
  }
  sift();
}

function sift() {
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const searching = words.length > 0 || only.checked;
  for (const group of groups) {
    let shown = 0;
    for (const { element } of group.made) {
      const fits = words.every((word) => element.dataset.find.includes(word)) && (!only.checked || element.classList.contains("changed"));
      element.hidden = !fits;
      shown += fits;
    }
    group.element.hidden = searching && !shown;
    if (searching && shown) {
      group.element.dataset.was ??= String(group.element.open);
      group.element.open = true;
    } else if (!searching && group.element.dataset.was) {
      group.element.open = group.element.dataset.was === "true";
      delete group.element.dataset.was;
    }
  }
}

filter.addEventListener("input", sift);
only.addEventListener("change", sift);

/** Shows the field that an error is about. */
export function reveal(path) {
  const found = fields.get(JSON.stringify(path));
  if (!found) return false;
  filter.value = "";
  only.checked = false;
  sift();
  found.element.closest("details").open = true;
  found.element.scrollIntoView({ block: "center" });
  found.element.querySelector("input, select").focus();
  return true;
}
