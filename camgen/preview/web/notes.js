// What the user should know, the gravest first as the build has them: each leads to its place, and a place to its note.
const KINDS_OF_NOTE = {
  refused: ["refused", "refused"], dangerous: ["dangerous", "dangerous"], unusual: ["unusual", "unusual"],
  gouge: ["gouge", "gouges"], excess: ["excess", "excesses"],
  skipped: ["left out", "left out"], warning: ["warning", "warnings"], assumed: ["assumption", "assumptions"],
  repaired: ["repaired", "repaired"], joined: ["joined", "joined"],
};
const GRAVE = ["refused", "dangerous", "gouge", "skipped", "warning"];
const notes = [
  ...(data.marks ?? []).map(({ kind, number: size, text, outline }) => ({
    kind, what: `${kind === "gouge" ? "Gouge" : "Excess"} ${number(size, 3)} mm`, why: text, strict: false, lines: [], paths: [], text: 0,
    places: [Array.from(unpack(outline).subarray(0, 3))],
  })),
  ...data.notes.map(([kind, what, why, strict, own, paths, places, text]) => ({ kind, what, why, strict, lines: own, paths, places, text })),
];
const isGrave = (note) => GRAVE.includes(note.kind) || note.strict;

// The first note on a line of the part, and on a path.
const noteOfLine = new Map();
const noteOfPath = new Map();
notes.forEach((note, k) => {
  for (const line of note.lines) if (!noteOfLine.has(line)) noteOfLine.set(line, k);
  for (const path of note.paths) if (!noteOfPath.has(path)) noteOfPath.set(path, k);
});

// Which one is pointed at, and where: points in the scene.
const pointed = { note: -1, places: [] };
const MOST_PLACES = 200;

// Half-way along a line of the part, and all of its points.
const lineRows = (k) => linePoints.subarray(3 * lineFirst[k], 3 * (lineFirst[k] + data.lines.counts[k]));

function placesOf(note) {
  const rows = note.lines.map(lineRows);
  const work = note.lines.length ? [] : note.paths.map(rowsOfPath);
  return [...rows, ...work, ...note.places];
}

function rowsOfPath(k) {
  const from = worked.findIndex((s) => track.path[track.event[s]] === k);
  if (from < 0) return [];
  let to = from;
  while (to + 1 < worked.length && track.path[track.event[worked[to + 1]]] === k) to++;
  return track.position.subarray(3 * worked[from] - 3, 3 * worked[to] + 3);
}

// The picture goes to what a note is about: nearer where that is small, never farther away than all of the part.
function lookAt(rows) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const points of rows) {
    for (let i = 0; i < points.length; i++) {
      low[i % 3] = Math.min(low[i % 3], points[i]);
      high[i % 3] = Math.max(high[i % 3], points[i]);
    }
  }
  if (low[0] > high[0]) return;
  const size = Math.hypot(...high.map((v, k) => v - low[k]));
  const wanted = Math.max(4 * size, 0.25 * extent);
  look.target = low.map((v, k) => (v + high[k]) / 2);
  look.height = Math.min(Math.max(look.height, wanted / 4), wanted);
  look.own = true;
  aim();
}

function pointAt(k, move = true) {
  pointed.note = k === pointed.note && move ? -1 : k;
  const rows = pointed.note < 0 ? [] : placesOf(notes[pointed.note]);
  pointed.places = rows.slice(0, MOST_PLACES).map((points) => {
    const middle = 3 * (points.length / 3 >> 1);
    return [points[middle], points[middle + 1], points[middle + 2]];
  });
  for (const element of $("notes").children) element.classList.toggle("picked", Number(element.dataset.note) === pointed.note);
  if (pointed.note >= 0 && move && rows.length) lookAt(rows);
  redraw();
}

// From the picture: the note is shown, the picture stays as it is.
function showNote(k) {
  if (k === undefined) return false;
  openTab("notes");
  pointAt(k, false);
  $("notes").querySelector(`[data-note="${k}"]`)?.scrollIntoView({ block: "nearest" });
  return true;
}

function showPointed() {
  const holder = $("pointed");
  while (holder.children.length > pointed.places.length) holder.lastChild.remove();
  while (holder.children.length < pointed.places.length) holder.append(make("i"));
  if (!pointed.places.length) return;
  setScreen();
  pointed.places.forEach((place, k) => {
    const [x, y] = toScreen(place, 0);
    holder.children[k].style.transform = `translate(${x}px, ${y}px)`;
  });
}

function countNotes() {
  const counts = new Map();
  for (const { kind } of notes) counts.set(kind, (counts.get(kind) ?? 0) + 1);
  return Object.keys(KINDS_OF_NOTE).filter((kind) => counts.has(kind)).map((kind) => [kind, counts.get(kind)]);
}

function setNotes() {
  const grave = notes.filter(isGrave).length;
  addTab("notes", notes.length ? `Notes ${notes.length}` : "Notes", grave ? "bad" : "");
  for (const [kind, count] of countNotes()) {
    const chip = make("button", `${count} ${KINDS_OF_NOTE[kind][count === 1 ? 0 : 1]}`, `chip ${kind}`);
    chip.setAttribute("aria-pressed", "false");
    chip.addEventListener("click", () => onlyNotes(kind, chip));
    $("kinds").append(chip);
  }
  notes.forEach((note, k) => {
    const element = make("div", "", `note ${note.kind}`);
    element.dataset.note = k;
    element.append(make("em", KINDS_OF_NOTE[note.kind][0]), make("b", note.what), make("span", note.why));
    if (note.text || note.lines.length || note.paths.length || note.places.length) {
      element.classList.add("placed");
      element.tabIndex = 0;
      element.setAttribute("role", "button");
      const show = () => (note.text ? showLine(note.text) : pointAt(k));
      element.addEventListener("click", show);
      element.addEventListener("keydown", (event) => {
        if (event.key !== "Enter") return;
        event.preventDefault();
        show();
      });
    }
    $("notes").append(element);
  });
  if (!notes.length) $("notes").append(make("p", "Nothing was left out, assumed or repaired.", "empty"));
  return grave;
}

// One kind only, all again by a second click.
function onlyNotes(kind, chip) {
  const on = chip.getAttribute("aria-pressed") !== "true";
  for (const one of $("kinds").children) one.setAttribute("aria-pressed", String(on && one === chip));
  for (const element of $("notes").children) element.hidden = on && notes[element.dataset.note].kind !== kind;
}
