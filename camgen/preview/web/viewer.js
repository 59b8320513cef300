// Ties it together: buttons, keys, colours, the frame loop.
const KEYS = [
  ["space", "play, pause"], ["left, right", "one motion back, on"], ["home, end", "begin, end of the program"],
  ["f", arm ? "fit part and paths" : "fit"], ...(arm ? [["F", "fit all, with the robot"]] : []), ["t, s, i", "top, side, oblique view"], ["m", "measure"],
  ["c", "next colouring"], ["l", "layers"], ["d", "light, dark, as the system"], ["esc", "let go of what is chosen"], ["?", "these keys"],
];
const MOUSE = [
  ["drag", "turn (one finger)"], ["right drag", "move (two fingers, or shift)"], ["wheel", "zoom (pinch)"],
  ["click", "name a path or an edge"], ["double click", "in the list: go to its start"], ["click", "on a line of the program: go there"],
];

let colouring = "order";

function legend(name) {
  for (const button of document.querySelectorAll(".switch button")) {
    button.setAttribute("aria-checked", String(button.dataset.by === name));
  }
  const { low, high, unit } = SCALES[name];
  const text = (value) => (name === "order" ? `path ${value + 1}` : `${number(value)}${unit}`);
  const same = !(high > low);
  $("low").textContent = Number.isFinite(low) ? text(low) : "none";
  $("high").textContent = same ? "" : text(high);
  const stops = ramp().map(rgb);
  $("ramp").style.background = same ? stops[0] : `linear-gradient(90deg, ${stops.join(", ")})`;
  colouring = name;
}

function colour(name) {
  colourBy(name);
  legend(name);
  redraw();
}

function setLegend() {
  const holder = document.querySelector(".switch");
  for (const [name, { label, high }] of Object.entries(SCALES)) {
    if (name === "force" && !(high > 0)) continue;
    const button = make("button", label);
    button.setAttribute("role", "radio");
    button.dataset.by = name;
    button.addEventListener("click", () => colour(name));
    holder.append(button);
  }
}

function setLayers() {
  for (const [name, layer] of Object.entries(layers)) {
    if (!layer.things.length && !["paths", "travel", "approach"].includes(name) && !(name === "photo" && data.photo) && !(name === "numbers" && numbers.length)) continue;
    const label = make("label");
    const tick = make("input");
    tick.type = "checkbox";
    tick.checked = !layer.off;
    tick.dataset.layer = name;
    tick.addEventListener("change", () => { layer.off = !tick.checked; showLayers(); redraw(); });
    const swatch = make("i");
    if (name === "travel") swatch.className = "dashed";
    else swatch.style.background = `var(--${layer.colour})`;
    label.append(tick, swatch, make("span", layer.label));
    $("layers").append(label);
  }
}

function setKeys() {
  for (const rows of [KEYS, MOUSE]) {
    const table = make("div");
    for (const [key, text] of rows) table.append(make("kbd", key), make("span", text));
    $("keys").append(table);
  }
  const close = make("button", "Close");
  close.addEventListener("click", () => $("keys").close());
  $("keys").append(close);
}

const ACTIONS = {
  top: () => turnTo("top"),
  side: () => turnTo("side"),
  iso: () => turnTo("iso"),
  fit: () => fit(false),
  all: () => fit(true),
  measure: () => setMeasure(!measure.on),
  layers: () => {
    $("layers").hidden = !$("layers").hidden;
    document.querySelector("[data-do=layers]").setAttribute("aria-pressed", String(!$("layers").hidden));
  },
  help: () => ($("keys").open ? $("keys").close() : $("keys").showModal()),
  play: () => player.play(!player.on),
  on: () => step(1),
  back: () => step(-1),
  begin: () => player.to(0),
  end: () => player.to(total),
  colour: () => {
    const names = [...document.querySelectorAll(".switch button")].map((button) => button.dataset.by);
    colour(names[(names.indexOf(colouring) + 1) % names.length]);
  },
  drop: () => { setMeasure(false); choose(-1); pointAt(-1); $("tip").hidden = true; },
  theme: nextTheme,
};
const KEYED = {
  " ": "play", ArrowRight: "on", ArrowLeft: "back", Home: "begin", End: "end", f: "fit", F: "all", t: "top", s: "side", i: "iso",
  m: "measure", l: "layers", c: "colour", d: "theme", "?": "help", Escape: "drop",
};

function setInput() {
  for (const button of document.querySelectorAll("[data-do]")) {
    button.hidden = button.dataset.do === "all" && !arm;
    button.addEventListener("click", () => ACTIONS[button.dataset.do]());
  }
  addEventListener("keydown", (event) => {
    if (event.defaultPrevented) return;
    const name = KEYED[event.key];
    if (!name || event.ctrlKey || event.metaKey || event.altKey || event.target === $("filter") || event.target.tagName === "SELECT") return;
    if ($("keys").open && name !== "help") return;
    // A button that has the focus is pressed by the space bar itself.
    if (event.key === " " && event.target.tagName === "BUTTON") return;
    event.preventDefault();
    ACTIONS[name]();
  });
  const spot = (event) => {
    const area = canvas.getBoundingClientRect();
    return [event.clientX - area.left, event.clientY - area.top];
  };
  canvas.addEventListener("click", (event) => {
    if (dragged > 4) return;
    const [x, y] = spot(event);
    const hit = under(x, y);
    if (measure.on) return measureAt(hit, x, y);
    tip(hit, x, y);
    choose(hit.path);
    if (hit.path >= 0) showNote(noteOfPath.get(hit.path));
    else if (!showNote(noteOfLine.get(hit.line))) pointAt(-1);
    tellPicked(hit);
  });
  // Looking for what is below the pointer at every move would be slow in large programs.
  if (!isLarge) {
    canvas.addEventListener("pointermove", (event) => {
      if (held.size || measure.on || event.pointerType === "touch") return;
      const [x, y] = spot(event);
      tip(under(x, y), x, y);
    });
    canvas.addEventListener("pointerleave", () => { $("tip").hidden = true; });
  }
}

function showTriad() {
  const holder = $("triad");
  holder.replaceChildren();
  const { right, up } = camera;
  ["x", "y", "z"].map((name, k) => [name, k, axisOf(k)])
    .forEach(([name, k, axis]) => {
      const [dx, dy] = [dot(axis, right), -dot(axis, up)];
      const stroke = ["#d6394a", "#2c9a52", "#3b7de0"][k];
      const element = (tag, attributes, text = "") => {
        const one = document.createElementNS("http://www.w3.org/2000/svg", tag);
        for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
        one.textContent = text;
        holder.append(one);
      };
      if (Math.hypot(dx, dy) < 0.12) return;
      element("line", { x1: 0, y1: 0, x2: 20 * dx, y2: 20 * dy, stroke, "stroke-width": 2 });
      element("text", { x: 27 * dx, y: 27 * dy, fill: stroke }, name);
    });
}

function showScale() {
  const most = 110 / shared.perMm.value;
  if (!(most > 0 && most < Infinity)) return; // before there is a window or anything in it
  const power = 10 ** Math.floor(Math.log10(most));
  const bar = [5, 2, 1, 0.5].map((m) => m * power).find((v) => v <= most); // the logarithm may be rounded up
  $("scale").replaceChildren(make("div", `${bar >= 1 ? bar : bar.toPrecision(1)} mm`), make("span"));
  $("scale").style.setProperty("--bar", `${bar * shared.perMm.value}px`);
}

function resize() {
  sizeCanvas();
  shared.pixel.value = pixelRatio();
  shared.size.value = [canvas.width, canvas.height];
  aim();
  fillList();
  fillListing();
}

function repaintTheme() {
  themed();
  themeNamed();
  shownFrom = null;
  legend(colouring);
  refillList();
  redraw();
}

// rough: 0 is the picture as it is meant, more is for frames that must come fast.
let shownFrom = null;
function paint(rough = 0) {
  stale = false;
  pace.drawn = rough;
  setDetail(isLarge ? rough : 0);
  for (const one of scene.parts) if (one.name === "plate") one.visible = !layers.part.off && (!data.photo || Boolean(layers.photo.off)) && (!cutting.stock || Boolean(layers.stock.off));
  cutting.shown?.paint();
  // Thinner than a pixel that is drawn, a line has holes.
  shared.thinnest.value = Math.min(rough, 1);
  if (gl) drawScene(scene, camera.whole, colourOf(css("scene")), rough === 0);
  if (shownFrom !== camera.whole) {
    showTriad();
    showScale();
    showMeasure();
  }
  shownFrom = camera.whole;
  showNumbers();
  showPointed();
  edits.paint?.();
}

// As much detail as is seen: what is left out is within a third of a pixel, and more in frames that must come fast.
const TOLERANCES = [0.3, 0.5, 1, 2, 4, 8];
function setDetail(rough) {
  const m = camera.whole;
  const [wide, high] = [look.height * (canvas.clientWidth / Math.max(canvas.clientHeight, 1)), look.height];
  // 20 pixels more than the picture: lines are wide.
  const isSeen = (balls, k) => {
    const [x, y, z] = [balls[k], balls[k + 1], balls[k + 2]];
    const out = balls[k + 3] + 20 / shared.perMm.value;
    return Math.abs(m[0] * x + m[4] * y + m[8] * z + m[12]) < 1 + (2 * out) / wide && Math.abs(m[1] * x + m[5] * y + m[9] * z + m[13]) < 1 + (2 * out) / high;
  };
  for (const choose_ of chains) choose_(TOLERANCES[rough] / pixelRatio() / shared.perMm.value, isSeen);
}

// Frames that come one after the other tell how fast this machine is. Where they are slow, what moves is drawn without
// smooth borders, then, where there is much to draw, with less detail; as it is meant when all is still.
const isLarge = stations + lineOf.length > 40000;
const pace = { rough: 0, most: isLarge ? TOLERANCES.length - 1 : 1, last: 0, still: 0, fast: 0, patience: 30, drawn: 0 };
const strideOf = (rough) => 2 ** Math.max(rough - 1, 0);
const AWAKE = 12;

function hurry(took) {
  if (took > 45) {
    pace.rough = Math.min(pace.rough + (took > 180 ? 2 : 1), pace.most);
    pace.patience = Math.min(2 * pace.patience, 2000);
    pace.fast = 0;
  } else if (took < 20 && pace.rough && ++pace.fast > pace.patience) {
    pace.rough--;
    pace.fast = 0;
  }
}

let isAwake = false;
function wake() {
  if (isAwake) return;
  isAwake = true;
  requestAnimationFrame(frame);
}

function frame(moment) {
  isAwake = false;
  player.tick(moment);
  if (cutting.stock?.work()) stale = true;
  if (stale) {
    if (pace.still === 0) hurry(moment - pace.last);
    paint(pace.rough);
    pace.last = moment;
    pace.still = 0;
  } else if (++pace.still === AWAKE) {
    // The first cut is waited for, and drawn as it is meant.
    if (data.stock) pace.most = Math.max(pace.most, 3);
    if (pace.drawn) paint();
  }
  if (stale || player.on || pace.still < AWAKE) wake();
}

function paintAtOnce() {
  // Before frames told anything: where the processor draws, the first picture comes sooner so.
  if (isDrawnByProcessor) pace.rough = Math.max(pace.rough, isLarge ? 2 : 1);
  paint(pace.rough);
  pace.still = 1;
  wake();
}

function setPrint() {
  addEventListener("beforeprint", () => {
    paint();
    const picture = make("img");
    if (gl) picture.src = canvas.toDataURL("image/png");
    const numbers = make("dl");
    for (const [label, text] of data.facts) numbers.append(make("dt", label), make("dd", text));
    $("print").replaceChildren(make("h1", data.title), picture, numbers);
    for (const { kind, what, why } of notes) {
      const [first, ...rest] = KINDS_OF_NOTE[kind][0];
      $("print").append(make("p", `${first.toUpperCase()}${rest.join("")}: ${what}${why ? ` (${why})` : ""}`));
    }
  });
}

$("title").textContent = data.title;
const grave = setNotes();
setList();
setListing();
addTab("facts", "Summary");
for (const [label, text] of data.facts) $("facts").append(make("dt", label), make("dd", text));
openTab(grave ? "notes" : data.lines.rows.length || data.listing.files.length === 0 ? "paths" : "text");
setLegend();
setLayers();
setKeys();
setPlayer();
setInput();
setPrint();
setHost();
showLayers();
repaintTheme();
themes.changed = repaintTheme;
colour("order");
resize();
// What is left in the end is seen first; play begins anew.
player.to(cutting.stock ? total : 0);
[look.turn, look.tilt] = VIEWS[isFlat && !arm && !cutting.stock ? "top" : "iso"];
begin();
let fitted = [canvas.clientWidth, canvas.clientHeight];
// A canvas of another size is empty: it is painted in the same turn, before the browser shows it.
new ResizeObserver(() => {
  const [wide, high] = fitted;
  if (wide === canvas.clientWidth && high === canvas.clientHeight) return;
  fitted = [canvas.clientWidth, canvas.clientHeight];
  resize();
  if (look.own) {
    if (high) look.height *= canvas.clientHeight / high;
    aim();
  } else (look.begun ? begin : fit)();
  paintAtOnce();
}).observe(canvas);
paintAtOnce();
tell({ camgen: "ready" });
// For whoever drives the page from outside, as tests do.
window.camgen = { keys: KEYS, data, player, look, track, arm, chosen, measure, pace, fit, box, orbit, framesOf, jointsAt, placeAt, paint, gl, toScreen, setScreen, toolGroup, cutting, notes, pointed, listing, toLine, pointAt, viewState, layers, matrixOf, inverse, moved };
