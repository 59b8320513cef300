// Layers on and off and in their order, contours and edges that are left out, and what was clicked in the picture.

import { ask, counted, draggable, make, move, set } from "./talk.js";

const home = document.getElementById("layers");
const card = document.getElementById("picked");
let state = null, picked = null;

export function showLayers(now) {
  state = now;
  const { looked } = now;
  home.replaceChildren(...(looked.layers.length ? layers() : []), ...leftOut(), ...orders());
  showPicked();
}

function layers() {
  const order = state.tables.tour?.layers ?? [];
  const names = [...order.filter((name) => state.looked.layers.some((one) => one.name === name)),
    ...state.looked.layers.map((one) => one.name).filter((name) => !order.includes(name))];
  const moved = (from, to) => { const found = move(names, from, to); if (found) ask("order", { layers: found }); };
  const rows = names.map((name, place) => {
    const layer = state.looked.layers.find((one) => one.name === name);
    const element = make("div", { className: "layer", data: { layer: name } });
    element.append(
      names.length > 1 ? draggable(element, place, "layer", moved) : "",
      make("label", {}, make("input", { type: "checkbox", checked: layer.used, onchange: (event) => ask("layer", { layer: name, on: event.target.checked }) }), name),
      make("small", {}, counted(layer.contours, "contour")));
    return element;
  });
  return [make("h2", {}, "Layers"), make("p", { className: "hint" }, "Switched off: input.layers leaves the layer out."), ...rows];
}

function leftOut() {
  const noun = state.looked.kind === "solid" ? "edge" : "contour";
  if (!state.left_out.length) {
    return [make("h2", {}, `Single ${noun}s`), make("p", { className: "hint" }, `Click one in the picture to leave it out.`)];
  }
  return [make("h2", {}, `Left out: ${counted(state.left_out.length, noun)}`),
    ...state.left_out.slice(0, 200).map((name) => make("div", { className: "layer" }, make("label", {}, name),
      make("button", { className: "small", onclick: () => ask("take", { names: [name] }) }, "Take in")))];
}

const BY_CAMGEN = "camgen finds the order of the paths and where closed ones begin (tour.method and tour.seam in the settings).";

function orders() {
  const own = state.tables.tour ?? {};
  const movable = ["drawing", "picture"].includes(state.looked.kind);
  const told = own.layers?.length ? `Layers run in this order: ${own.layers.join(", ")}.` : "Drag layers by their handles to run them in that order (tour.layers).";
  const reset = own.layers?.length ? make("div", { className: "bar" }, make("button", { onclick: () => set(["tour", "layers"], null) }, "Any order")) : null;
  const several = state.looked.layers.length > 1 ? make("p", { className: "hint" }, told) : "";
  return [make("h2", {}, "Order and seams"), several, reset ?? "",
    make("p", { className: "hint" }, state.looked.kind === "solid" ? "camgen finds the order of the edges and the links between them." : BY_CAMGEN),
    ...(movable ? [...single(own.order, "order", "Drag a row of the list of paths to another place, or choose it and press Alt and an arrow key, to run it there (tour.order).",
      (list) => `${counted(list.length, "contour")} run first: ${shorten(list)}`),
    ...single(own.seams, "seams", "Click a closed path: the ring where it begins is dragged along it (tour.seams).",
      (list) => `${counted(list.length, "seam")} set.`)] : [])];
}

/** What is set of single contours, and a button that gives it up. */
function single(list, key, usual, told) {
  if (!Array.isArray(list) || !list.length) return [make("p", { className: "hint" }, usual)];
  return [make("p", { className: "hint" }, `${usual} ${told(list)}`),
    make("div", { className: "bar" }, make("button", { onclick: () => set(["tour", key], null) }, key === "order" ? "No order of my own" : "No seams of my own"))];
}

const shorten = (list) => `${list.slice(0, 12).join(", ")}${list.length > 12 ? " ..." : ""}`;

// What was clicked.

export function pick(found, build) {
  picked = found.path >= 0 || found.id ? { ...found, build } : null;
  showPicked();
}

/** What was clicked, in the program that is shown now: paths may have other numbers. */
function follow() {
  const build = state?.built?.number;
  if (!picked || build === undefined || picked.build === build) return;
  picked.build = build;
  if (picked.path < 0) return;
  picked.path = state.looked.runs.findIndex((one) => one.id === picked.id);
  if (picked.path < 0) picked = null;
}

function showPicked() {
  follow();
  card.hidden = !picked || !state;
  if (card.hidden) return;
  const run = picked.path >= 0 ? state.looked.runs[picked.path] : null;
  const solid = state.looked.kind === "solid";
  const names = run ? run.contours : [picked.id].filter(Boolean);
  const out = names.length > 0 && names.every((name) => state.left_out.includes(name));
  const told = names.length > 3 ? counted(names.length, "contour") : names.join(", ");
  const fixed = ["curves", "program"].includes(state.looked.kind) || !names.length;
  // What no path was wanted for can be taken in; what has a path, or should have one, can be left out.
  const idle = out || (solid && picked.source === "edge");
  const idling = state.looked.worked.length > 0 && picked.source === "edge";
  card.replaceChildren(
    make("b", {}, picked.id || told),
    picked.layer ? make("span", {}, `layer ${picked.layer}`) : "",
    fixed ? "" : idle || idling
      ? make("button", { onclick: () => { ask("take", { names }); close(); } }, `Take in ${told}`)
      : make("button", { onclick: () => leave(names, run?.row ?? -1) }, `Leave out ${told}`),
    run?.point ? make("button", { onclick: () => { ask("seam", { build: picked.build, path: picked.path }); close(); } }, "Seam chosen by camgen") : "",
    picked.layer && state.looked.layers.some((one) => one.name === picked.layer)
      ? make("button", { onclick: () => { ask("layer", { layer: picked.layer, on: false }); close(); } }, `Leave out layer ${picked.layer}`) : "",
    make("button", { className: "small", ariaLabel: "Close", onclick: close }, "\u2715"));
}

function leave(names, row) {
  ask("leave", { names, row });
  close();
}

function close() {
  picked = null;
  showPicked();
}
