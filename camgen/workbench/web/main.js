// The shell of the workbench: it shows the state that the workbench sends, and sends what the user changes.

import { applyTyped, isTyped } from "./fields.js";
import { onSaid, setTheme, showBuild, shownWindow } from "./frames.js";
import { useKeys } from "./keys.js";
import { pick, showLayers } from "./layers.js";
import { buildSettings, fields, openUsual, reveal, showSettings } from "./settings.js";
import { revealRow, rowFields, showSteps } from "./steps.js";
import { ask, askSave, counted, make } from "./talk.js";

const by = (id) => document.getElementById(id);
//: The exit code of a build that was given up.
const STOPPED = 130;
let form = null, state = null, refused = "", gone = false, usual = false;

// The state.

const events = new EventSource("events");
let before = Promise.resolve();
events.addEventListener("message", (event) => (before = before.then(() => take(JSON.parse(event.data)))));

async function take(now) {
  now.looked ??= state.looked; // told when it is new
  for (const name of ["operations", "tools"]) if (!Array.isArray(now.tables[name])) delete now.tables[name];
  if (!form || state?.post !== now.post) {
    form = await (await fetch("form")).json();
    buildSettings(form);
  }
  if (now.number !== state?.number) refused = "";
  state = now;
  gone = false;
  show();
}

events.addEventListener("error", () => {
  gone = true;
  showSays();
});

// A change of which nothing would come is not made.
function lock() {
  for (const element of [document.querySelector("aside"), by("post"), by("undo"), by("redo"), by("save")]) element.inert = gone || Boolean(state?.closing);
}

function show() {
  by("title").textContent = state.inputs.join(", ");
  document.title = `${state.saved ? "" : "\u2022 "}${state.inputs[0]} - camgen`;
  showPosts();
  by("stage").textContent = state.stage ? `${state.stage} ...` : state.built ? `built in ${state.built.seconds} s` : "";
  by("stage").classList.toggle("busy", Boolean(state.stage));
  by("stop").hidden = !state.stage;
  by("undo").disabled = !state.undo;
  by("redo").disabled = !state.redo;
  by("save").disabled = Boolean(state.failed) && !state.stage;
  showSettings(state);
  if (!usual && (state.looked.kind || state.failed)) {
    usual = true;
    openUsual(state.looked.kind || (state.picture ? "picture" : "drawing"));
  }
  showSteps(state, form);
  showLayers(state);
  showSummary();
  showFile();
  showPictures();
  blame();
  showSays();
  if (state.closing) events.close();
}

function showPosts() {
  const select = by("post");
  if (select.options.length !== state.posts.length) {
    select.replaceChildren(...state.posts.map((name) => make("option", { value: name }, name)));
  }
  select.value = state.post;
}

function showSummary() {
  const rows = state.built?.rows ?? [];
  by("summary").replaceChildren(
    make("dl", {}, ...rows.flatMap(([label, text, tone]) => [make("dt", {}, label), make("dd", { className: `tone-${tone}` }, text)])));
}

function showFile() {
  by("file").replaceChildren(
    make("h2", {}, state.job_file, state.saved ? "" : " (not saved)"), make("pre", {}, state.text),
    make("h2", {}, "The same on the command line"), make("pre", {}, state.command),
    make("div", { className: "bar" },
      make("button", { onclick: () => navigator.clipboard.writeText(state.text) }, "Copy the job"),
      make("button", { onclick: () => navigator.clipboard.writeText(state.command) }, "Copy the command")));
}

// Pictures.

let view = "page";

function showPictures() {
  if (state.built) showBuild(state.built.number);
  by("frames").classList.toggle("stale", Boolean(state.failed) && !state.stage);
  by("empty").hidden = Boolean(state.built);
  by("empty").textContent = state.failed ? "There is no program yet: see the line above." : "The first program is being built ...";
  by("views").hidden = !state.picture;
  if (state.picture && by("picture").dataset.number !== String(state.picture)) {
    by("picture").dataset.number = state.picture;
    by("picture").firstElementChild.src = `picture/${state.picture}`;
  }
  if (state.picture && !state.built) view = "picture";
  const name = state.picture ? view : "page";
  by("picture").hidden = name !== "picture";
  for (const tab of by("views").children) tab.setAttribute("aria-selected", tab.dataset.view === name);
}

by("views").addEventListener("click", (event) => {
  view = event.target.dataset.view ?? view;
  showPictures();
});
onSaid("picked", pick);
onSaid("seam", ({ path, x, y, draft }, build) => ask("seam", { build, path, x, y, draft: draft === true }));
onSaid("moved", ({ path, to }, build) => ask("move", { build, path, to }));

// What is said.

/** The field that the error names has its line. */
function blame() {
  const place = JSON.stringify(state.failed?.place ?? []);
  for (const [path, one] of [...fields, ...rowFields]) one.blame(path === place ? state.failed.line : "");
}

function showSays() {
  const lines = [];
  const line = (tone, text, ...buttons) => lines.push(make("p", { className: tone }, make("span", {}, text), ...buttons));
  lock();
  if (state?.closing) {
    const kept = state.unsaved ? ` ${counted(state.unsaved, "change")} not saved: the terminal shows where they are kept.` : "";
    line("look", `The workbench is closed.${kept} Start it again with camgen open; this page can be shut.`);
  }
  else if (gone) {
    line("bad", "The workbench does not answer: it has ended, or the machine slept. This page tries again.",
      make("button", { onclick: () => navigator.clipboard.writeText(state?.text ?? "") }, "Copy the job"));
  }
  if (state?.journal_fault) line("bad", `Changes that are not saved are lost when the workbench ends: ${state.journal_fault}`);
  if (state?.offer) showOffer(line);
  if (state?.changed_outside) {
    line("look", `${state.job_file} was changed outside the workbench, and here too.`,
      make("button", { onclick: () => ask("file", { counts: true }) }, "Read the file"),
      make("button", { onclick: () => ask("file", { counts: false }) }, "Keep the form"));
  }
  if (refused) line("bad", refused, make("button", { className: "small", ariaLabel: "Close", onclick: () => { refused = ""; showSays(); } }, "\u2715"));
  if (state?.failed && !state.stage) {
    const place = state.failed.place;
    line("bad", state.failed.line, place.length > 1 ? make("button", { onclick: () => go(place) }, "Show the setting") : "",
      state.failed.code === STOPPED ? make("button", { onclick: () => ask("build") }, "Build again") : "");
  }
  if (state?.told) line("look", state.told);
  by("says").replaceChildren(...lines);
}

/** Changes of an earlier workbench that were not saved. */
function showOffer(line) {
  const { changes, time, fits, text } = state.offer;
  const what = `${counted(changes, "change")} of ${state.job_file} from ${time} ${changes === 1 ? "was" : "were"} not saved.`;
  const since = fits ? "" : ` ${state.job_file} has changed since: if you take them up, they replace its settings; undo brings these back.`;
  line("look", what + since,
    make("button", { onclick: () => ask("journal", { counts: true }) }, "Take up"),
    make("button", { onclick: () => navigator.clipboard.writeText(text) }, "Copy the job"),
    make("button", { onclick: () => confirm(`Discard ${counted(changes, "change")} of ${state.job_file}? This cannot be undone.`) && ask("journal", { counts: false }) }, "Discard"));
}

document.addEventListener("refused", (event) => {
  refused = event.detail;
  showSays();
});

/** Opens the place of the form that an error names. */
function go(place) {
  const row = place.length === 3 || typeof place[1] === "number";
  openTab(row ? "steps" : "settings");
  if (row) revealRow(place);
  else reveal(place);
}

// Tabs, buttons and keys.

function openTab(name) {
  for (const tab of document.querySelectorAll("aside [role=tab]")) {
    tab.setAttribute("aria-selected", tab.dataset.tab === name);
    by(tab.dataset.tab).hidden = tab.dataset.tab !== name;
  }
}

document.querySelector("aside nav").addEventListener("click", (event) => event.target.dataset.tab && openTab(event.target.dataset.tab));
by("post").addEventListener("change", (event) => ask("post", { post: event.target.value }));
by("stop").addEventListener("click", () => ask("stop"));
by("undo").addEventListener("click", () => ask("undo"));
by("redo").addEventListener("click", () => ask("redo"));
by("close").addEventListener("click", () => {
  if (!state?.unsaved || confirm("What was changed is not saved. It is kept, and offered by the next camgen open. Close?")) ask("close");
});
by("save").addEventListener("click", save);

async function save() {
  applyTyped();
  const answer = await askSave({});
  if (answer?.edited && confirm(`${answer.edited.join(", ")} was changed by hand since camgen wrote it. Replace it?`)) await askSave({ replace: true });
}

useKeys({ save, undo: () => ask("undo"), redo: () => ask("redo") }, shownWindow);

addEventListener("beforeunload", (event) => {
  const isUnsaved = state?.unsaved || (document.activeElement && isTyped(document.activeElement));
  if (isUnsaved && !state?.closing && !gone) event.preventDefault();
});

const THEMES = ["", "light", "dark"];
let theme = sessionStorage.getItem("theme") ?? "";

function useTheme() {
  if (theme) document.documentElement.dataset.theme = theme;
  else delete document.documentElement.dataset.theme;
  by("theme").textContent = { "": "Theme: system", light: "Theme: light", dark: "Theme: dark" }[theme];
  sessionStorage.setItem("theme", theme);
  setTheme(theme);
}

by("theme").addEventListener("click", () => {
  theme = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];
  useTheme();
});
useTheme();

// For tests and for the curious.
window.workbench = { state: () => state };
