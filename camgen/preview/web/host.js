// Where the page stands in a frame of a page of the same origin: what is clicked goes out, wishes come in.
const framed = window.parent !== window;

// A host that listens to this window hears it at once, before anything else can happen; any other one has a message.
function tell(message) {
  if (framed && !dispatchEvent(new CustomEvent("camgen", { detail: message, cancelable: true }))) return;
  if (framed && location.origin !== "null") window.parent.postMessage(message, location.origin);
}

// What was hit in the picture, or a row of the list: `place` in the scene, or none.
function tellPicked({ path, line, place }) {
  const row = path >= 0 ? data.paths[path] : line >= 0 ? data.lines.rows[line] : { id: "", layer: "" };
  const skipped = line >= 0 && ["skipped", "wrong"].includes(data.lines.rows[line].state);
  const source = path >= 0 ? "path" : line >= 0 ? (skipped ? "skipped" : "edge") : "";
  const [x, y, z] = place ? place.map((v, k) => v + origin[k]) : [null, null, null];
  tell({ camgen: "picked", path, id: row.id, layer: row.layer, source, x, y, z });
}

const viewState = () => ({
  camera: {
    turn: look.turn, tilt: look.tilt, height: look.height, whole: look.whole, own: look.own,
    target: plus(look.target, origin),
  },
  time: player.time, part: total > 0 ? player.time / total : 0, speed: player.speed, colouring,
  layers: Object.fromEntries(Object.entries(layers).map(([name, layer]) => [name, !layer.off])),
  cards: { layers: !$("layers").hidden }, tab: tabs.open, theme: themes.chosen,
  id: chosen.path >= 0 ? data.paths[chosen.path].id : "", side: document.body.style.getPropertyValue("--side"), focused: edits.focused?.() ?? "",
});

const isNumber = (value) => typeof value === "number" && Number.isFinite(value);

function restoreCamera(asked) {
  for (const name of ["turn", "tilt"]) if (isNumber(asked[name])) look[name] = asked[name];
  look.tilt = Math.min(Math.max(look.tilt, -Math.PI / 2), Math.PI / 2);
  // Where the picture was fitted, it is fitted to what there is now.
  if (!asked.own) return asked.whole || arm ? begin() : fit(false);
  if (isNumber(asked.height) && asked.height > 0) look.height = asked.height;
  if (Array.isArray(asked.target) && asked.target.length === 3 && asked.target.every(isNumber)) {
    look.target = minus(asked.target, origin);
  }
  look.own = true;
  aim();
}

function restore(state) {
  for (const [name, shown] of Object.entries(state.layers ?? {})) if (Object.hasOwn(layers, name)) layers[name].off = !shown;
  for (const tick of document.querySelectorAll("#layers input")) tick.checked = !layers[tick.dataset.layer].off;
  showLayers();
  if (typeof state.cards?.layers === "boolean" && $("layers").hidden === state.cards.layers) ACTIONS.layers();
  if ("theme" in state) setTheme(state.theme);
  if (/^\d+(\.\d+)?px$/.test(state.side)) setWidth(parseFloat(state.side));
  if ([...document.querySelectorAll(".switch button")].some((button) => button.dataset.by === state.colouring)) colour(state.colouring);
  if (SPEEDS.includes(state.speed)) $("speed").value = player.speed = state.speed;
  // The end stays the end, however long the program is now.
  if (isNumber(state.time)) player.to(state.part >= 1 ? total : state.time);
  if (state.camera) restoreCamera(state.camera);
  if ($(`tab-${state.tab}`)) openTab(state.tab);
  choose(data.paths.findIndex((path) => path.id === state.id));
  paint();
  edits.focus?.(state.focused);
}

// As a click on the path, or on the line of the part, of that id.
function chooseId(id) {
  const path = data.paths.findIndex((one) => one.id === id);
  choose(path);
  if (path < 0) showNote(noteOfLine.get(data.lines.rows.findIndex((line) => line.id === id)));
}

const WISHES = {
  "state?": () => tell({ camgen: "state", state: viewState() }),
  restore: ({ state }) => { if (state && typeof state === "object") restore(state); },
  choose: ({ id }) => chooseId(String(id)),
  theme: ({ theme }) => setTheme(theme),
};

function setHost() {
  if (!framed) return;
  addEventListener("message", (event) => {
    if (event.source !== window.parent || event.origin !== location.origin || typeof event.data?.camgen !== "string") return;
    if (Object.hasOwn(WISHES, event.data.camgen)) WISHES[event.data.camgen](event.data);
  });
}
