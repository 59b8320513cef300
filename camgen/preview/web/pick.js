// What lies under the pointer, found on the screen: the nearest segment of the paths or of the part, or a point on it.
const REACH = 9;

function toScreen(points, index) {
  const m = onScreen.m;
  const [x, y, z] = [points[3 * index], points[3 * index + 1], points[3 * index + 2]];
  return [m[0] * x + m[4] * y + m[8] * z + m[12], m[1] * x + m[5] * y + m[9] * z + m[13]];
}

const onScreen = { m: [] };
function setScreen() {
  const [w, h] = [canvas.clientWidth / 2, canvas.clientHeight / 2];
  onScreen.m = product(framed3([w, 0, 0], [0, -h, 0], [0, 0, 1], [w, h, 0]), camera.whole);
}

// The segment of a chain that comes nearest to (x, y): its end, where on it 0..1, and how far away in pixels.
function nearest(points, x, y, counts) {
  let best = { gap: REACH };
  let before = null;
  for (let i = 0; i < points.length / 3; i++) {
    const here = toScreen(points, i);
    if (before && counts(i)) {
      const [dx, dy] = [here[0] - before[0], here[1] - before[1]];
      const run = dx * dx + dy * dy;
      const share = run > 0 ? Math.min(Math.max(((x - before[0]) * dx + (y - before[1]) * dy) / run, 0), 1) : 0;
      const gap = Math.hypot(before[0] + dx * share - x, before[1] + dy * share - y);
      if (gap < best.gap) best = { gap, end: i, share, length: Math.sqrt(run) };
    }
    before = here;
  }
  return best;
}

const lineOf = new Int32Array(linePoints.length / 3);
data.lines.counts.forEach((count, k) => lineOf.fill(k, lineFirst[k], lineFirst[k] + count));
const lineShown = (k) => !layers[STATES[data.lines.rows[k].state][0]].off;

function under(x, y) {
  setScreen();
  const path = layers.paths.off ? { gap: REACH } : nearest(track.position, x, y, (i) => wayGroup[i] >= 0);
  const line = nearest(linePoints, x, y, (i) => lineOf[i] === lineOf[i - 1] && lineShown(lineOf[i]));
  const found = { path: -1, line: -1, place: null };
  const on = (points, hit) => {
    // A corner that is close enough is meant.
    const corner = Math.round(hit.share);
    const share = Math.abs(hit.share - corner) * hit.length < REACH ? corner : hit.share;
    return [0, 1, 2].map((k) => points[3 * hit.end - 3 + k] + (points[3 * hit.end + k] - points[3 * hit.end - 3 + k]) * share);
  };
  if (path.end !== undefined && path.gap <= line.gap + 1) return { ...found, path: wayGroup[path.end], place: on(track.position, path) };
  if (line.end !== undefined) return { ...found, line: lineOf[line.end], place: on(linePoints, line) };
  return found;
}

function said(hit) {
  if (hit.path >= 0) {
    const path = data.paths[hit.path];
    const force = path.force > 0 ? `, ${number(path.force)} N` : "";
    return [`Path ${hit.path + 1} of ${data.paths.length}: ${path.id}`, [path.operation, path.layer, `${number(path.length)} mm`, `${number(path.feed)} mm/s${force}`].filter(Boolean).join(", "), ""];
  }
  const line = data.lines.rows[hit.line];
  const state = { done: "", skipped: `Left out: ${line.why}`, wrong: line.why, noted: line.why, unused: "No path of its own", seen: "Outline in the photo" }[line.state];
  return [line.id, [line.layer, `${number(line.length)} mm`, line.closed ? "closed" : ""].filter(Boolean).join(", "), state];
}

function tip(hit, x, y) {
  const card = $("tip");
  card.hidden = hit.path < 0 && hit.line < 0;
  if (card.hidden) return;
  const [title, text, why] = said(hit);
  card.replaceChildren(make("b", title), make("span", text), make("div", why, "why"));
  card.style.left = `${Math.min(x + 14, Math.max(canvas.clientWidth - card.offsetWidth - 8, 4))}px`;
  card.style.top = `${y + 16 + card.offsetHeight > canvas.clientHeight ? y - card.offsetHeight - 12 : y + 16}px`;
}

// Measuring: two points, the line between them, and the distance in mm.
const measure = { on: false, points: [] };
function setMeasure(on) {
  measure.on = on;
  measure.points = [];
  canvas.classList.toggle("measuring", on);
  document.querySelector("[data-do=measure]").setAttribute("aria-pressed", String(on));
  $("hint").hidden = !on;
  $("hint").textContent = "Measure: click two points of paths or part";
  $("tip").hidden = true;
  showMeasure();
}

// On a flat part a point need not be on a line: the plane of the drawing is meant.
function planePoint(x, y) {
  if (!isFlat || Math.abs(Math.sin(look.tilt)) < 0.05) return null;
  const beside = onward(look.target, camera.right, (x - canvas.clientWidth / 2) / shared.perMm.value);
  const at = onward(beside, camera.up, (canvas.clientHeight / 2 - y) / shared.perMm.value);
  return onward(at, camera.ahead, (-origin[2] - at[2]) / camera.ahead[2]);
}

function measureAt(hit, x, y) {
  const place = hit.place ?? planePoint(x, y);
  if (!place) return;
  measure.points = measure.points.length === 2 ? [place] : [...measure.points, place];
  showMeasure();
}

function showMeasure() {
  const holder = $("marks");
  holder.replaceChildren();
  if (!measure.points.length) return;
  setScreen();
  const spots = measure.points.map((point) => toScreen(point, 0));
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const add = (tag, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    svg.append(element);
  };
  const colour = css("pick");
  if (spots.length === 2) add("line", { x1: spots[0][0], y1: spots[0][1], x2: spots[1][0], y2: spots[1][1], stroke: colour, "stroke-width": 2 });
  spots.forEach(([cx, cy]) => add("circle", { cx, cy, r: 4.5, fill: colour, stroke: css("scene"), "stroke-width": 1.5 }));
  holder.append(svg);
  if (spots.length < 2) return;
  const [dx, dy, dz] = [0, 1, 2].map((k) => measure.points[1][k] - measure.points[0][k]);
  const label = make("div", `${number(Math.hypot(dx, dy, dz), 3)} mm`, "card");
  label.append(make("small", `dx ${number(dx, 2)}  dy ${number(dy, 2)}  dz ${number(dz, 2)}`));
  holder.append(label);
  const half = label.offsetWidth / 2 + 6;
  label.style.left = `${Math.min(Math.max((spots[0][0] + spots[1][0]) / 2, half), canvas.clientWidth - half)}px`;
  label.style.top = `${Math.max((spots[0][1] + spots[1][1]) / 2, 46)}px`;
}
