// Light or dark: as the system has it, or as the switch says, which the browser remembers where it may.
const THEMES = ["", "light", "dark"];
const scheme = matchMedia("(prefers-color-scheme: dark)");
const themes = { chosen: "", changed: () => {} };

const isDark = () => document.documentElement.dataset.theme === "dark";

function setTheme(name) {
  themes.chosen = THEMES.includes(name) ? name : "";
  document.documentElement.dataset.theme = themes.chosen || (scheme.matches ? "dark" : "light");
  const label = { "": "as the system", light: "light", dark: "dark" }[themes.chosen];
  $("theme").textContent = { "": "\u25d0", light: "\u2600", dark: "\u263e" }[themes.chosen];
  $("theme").title = `Colours: ${label} (d)`;
  $("theme").setAttribute("aria-label", $("theme").title);
  themes.changed();
}

// From a file, or where storage is off, a browser may refuse: then the choice lasts as long as the page.
function remember(name) {
  try {
    if (name) localStorage.setItem("camgen.theme", name);
    else localStorage.removeItem("camgen.theme");
  } catch { /* nothing is lost but the memory of it */ }
}

function recall() {
  try {
    return localStorage.getItem("camgen.theme") ?? "";
  } catch {
    return "";
  }
}

// System, then the other one, then the one that the system has.
function nextTheme() {
  const order = ["", ...(scheme.matches ? ["light", "dark"] : ["dark", "light"])];
  setTheme(order[(order.indexOf(themes.chosen) + 1) % 3]);
  remember(themes.chosen);
}

scheme.addEventListener("change", () => setTheme(themes.chosen));
setTheme(recall());
