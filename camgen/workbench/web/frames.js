// The preview: a build's page in a frame. A newer one is loaded behind it, takes over its state, and is then shown.

import { listen } from "./keys.js";

const home = document.getElementById("frames");
//: ms that a page may take to say that it is ready, once it is loaded, and to say its state.
const QUIET = 1500, STATE = 150;
let shown = null, coming = null, wanted = 0, theme = "", answer = null, kept = load();
const heard = new Map();

/** What a page says, "picked", "seam" or "moved", with the number of its build. */
export const onSaid = (name, call) => heard.set(name, call);

/** The window of the page that is seen, null while there is none. */
export const shownWindow = () => shown?.contentWindow ?? null;

/** Shows the page of a build. */
export function showBuild(number) {
  if (number === wanted) return;
  wanted = number;
  coming?.remove();
  const frame = document.createElement("iframe");
  frame.title = "The program";
  frame.className = "coming";
  frame.addEventListener("load", () => setTimeout(() => swap(frame), QUIET));
  frame.src = `page/${number}`;
  coming = frame;
  home.append(frame);
}

async function swap(frame) {
  if (frame !== coming) return;
  coming = null;
  listen(frame.contentWindow);
  frame.contentWindow.addEventListener("camgen", (event) => hear(frame, event.detail) && event.preventDefault());
  kept = (shown && (await stateOf(shown))) || kept;
  if (kept) tell(frame, { camgen: "restore", state: kept });
  if (theme) tell(frame, { camgen: "theme", theme });
  await paint();
  if (coming && shown) { frame.remove(); return; } // a newer one is on its way
  frame.className = "";
  shown?.remove();
  shown = frame;
  document.getElementById("empty").hidden = true;
}

const paint = () => new Promise((done) => {
  requestAnimationFrame(() => requestAnimationFrame(done));
  setTimeout(done, 100); // a hidden tab paints nothing
});

function tell(frame, message) {
  frame.contentWindow?.postMessage(message, location.origin);
}

/** The state of a page: null where it says none in time. */
function stateOf(frame) {
  return new Promise((done) => {
    answer = { frame, done };
    setTimeout(() => done(null), STATE);
    tell(frame, { camgen: "state?" });
  });
}

addEventListener("message", (event) => {
  const frame = [coming, shown].find((one) => one && one.contentWindow === event.source);
  if (event.origin !== location.origin || !frame || typeof event.data?.camgen !== "string") return;
  const said = event.data;
  if (said.camgen === "ready" && frame === coming) swap(frame);
  hear(frame, said);
  if (said.camgen === "state" && answer?.frame === frame) {
    kept = said.state;
    answer.done(said.state);
  }
});

/** Whether what a page says is for the rest of the shell, which has it then. */
function hear(frame, said) {
  const call = frame === shown && heard.get(said.camgen);
  if (call) call(said, Number(frame.getAttribute("src").split("/").pop()));
  return Boolean(call);
}

export function setTheme(name) {
  theme = name;
  for (const frame of [shown, coming]) if (frame) tell(frame, { camgen: "theme", theme });
}

/** A path of the program as if it had been clicked. */
export const choose = (id) => shown && tell(shown, { camgen: "choose", id });

// After a reload the picture is as it was.

function load() {
  try { return JSON.parse(sessionStorage.getItem("page")); } catch { return null; }
}

setInterval(async () => {
  const found = shown && !document.hidden && (await stateOf(shown));
  if (found) sessionStorage.setItem("page", JSON.stringify(found));
}, 2000);
