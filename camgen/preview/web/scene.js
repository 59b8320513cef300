// What stands in the work frame: part, paths, starts, arrows, tool axes. Coordinates are told from `origin`.
const scene = thing();
// What plays the cut and what shows it: stock.js, which only pages of jobs that cut have.
const cutting = { stock: null, shown: null, tool: null };
// What changes the order and the seams of paths: edit.js, which only pages of the workbench have.
const edits = {};
const box = { low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] };

function growBy(points, from, to) {
  for (let i = from; i < to; i++) {
    const k = i % 3;
    if (points[i] < box.low[k]) box.low[k] = points[i];
    if (points[i] > box.high[k]) box.high[k] = points[i];
  }
}
const grow = (points) => growBy(points, 0, points.length);

const solidPoints = data.solid ? unpack(data.solid.vertices) : null;
if (solidPoints) grow(solidPoints);
grow(linePoints);
if (data.stock) [data.stock.low, data.stock.high].forEach(grow);
// The way from home may be far away: only what is worked on counts for the size of the picture.
const worked = workedStations();
function workedStations() {
  const found = [];
  for (let s = 1; s < stations; s++) {
    if (track.path[track.event[s]] < 0) continue;
    found.push(s);
    growBy(track.position, 3 * s, 3 * s + 3);
  }
  return found;
}
if (box.low[0] > box.high[0]) grow(track.position);
const extent = Math.max(Math.hypot(...box.high.map((v, k) => v - box.low[k])), 1e-3);
const isFlat = data.flat;

// Layers: name, colour in the style sheet, the things that are shown.
const layers = {
  stock: { label: "Stock", colour: "stock", things: [] },
  photo: { label: "Picture", colour: "unused", things: [] },
  part: { label: "Part", colour: "part", things: [] },
  seen: { label: "Photo's outline", colour: "seen", things: [] },
  skipped: { label: "Left out", colour: "bad", things: [] },
  fixtures: { label: data.standing.some(([name]) => name === "table") ? "Table" : "Fixtures", colour: "fixture", things: [] },
  unused: { label: "Not asked for", colour: "unused", things: [] },
  numbers: { label: "Numbers", colour: "accent", things: [] },
  paths: { label: "Tool paths", colour: "accent", things: [] },
  executed: { label: "Executed path", colour: "executed", things: [], off: true },
  arrows: { label: "Directions", colour: "ink", things: [] },
  starts: { label: "Starts", colour: "ink", things: [] },
  approach: { label: "Travel in lines", colour: "near", things: [] },
  travel: { label: "Free travel", colour: "travel", things: [] },
  gouge: { label: "Gouge", colour: "bad", things: [] },
  excess: { label: "Excess", colour: "excess", things: [] },
  axes: { label: "Tool axes", colour: "tool", things: [], off: isFlat },
  tool: { label: "Tool", colour: "tool", things: [] },
  robot: { label: "Robot", colour: "arm-joint", things: [], off: false },
  boxes: { label: "Tested cuboids", colour: "boxes", things: [], off: true },
};

function put(layer, one, order) {
  one.order = order;
  scene.parts.push(one);
  layers[layer].things.push(one);
  return one;
}

// Contours and edges, one mesh for each state.
const STATES = { done: ["part", 1.4], skipped: ["skipped", 2.2], wrong: ["skipped", 4], noted: ["part", 2.5], unused: ["unused", 1.2], seen: ["seen", 1.2] };
for (const [state, [layer, width]] of Object.entries(STATES)) {
  const rows = data.lines.rows.flatMap((line, k) => (line.state === state ? [k] : []));
  const count = rows.reduce((sum, k) => sum + data.lines.counts[k], 0);
  if (!count) continue;
  const points = new Float32Array(3 * count);
  const group = new Float32Array(count);
  let at = 0;
  for (const k of rows) {
    const [from, many] = [lineFirst[k], data.lines.counts[k]];
    points.set(linePoints.subarray(3 * from, 3 * (from + many)), 3 * at);
    group.fill(k, at, at + many);
    group[at] = -2;
    at += many;
  }
  put(layer, lines({ points, group, width, picks: 1 }), layer === "skipped" ? 3 : 2);
}

// A closed contour as triangles that cover what is in it an odd number of times: corners are cut off, every second one
// and again, so that most triangles are small. In a fan from one corner all of them are long.
function coverOdd(first, count, index) {
  for (let step = 1; 2 * step < count; step *= 2) {
    for (let k = 0; k + step < count; k += 2 * step) {
      index.push(first + k, first + k + step, first + (k + 2 * step < count ? k + 2 * step : 0));
    }
  }
}

// The sheet inside closed contours, even-odd: every triangle turns the stencil over, a square fills what is left odd.
function sheet() {
  const closed = data.lines.rows.flatMap((line, k) => (line.closed && line.state !== "unused" ? [k] : []));
  if (!isFlat || !closed.length) return;
  const index = [];
  for (const k of closed) coverOdd(lineFirst[k], data.lines.counts[k], index);
  const common = { name: "plate", shine: 0, clear: true, depthWrite: false };
  const { sorted, higher } = byHeight(linePoints, index);
  const odd = shape({ points: linePoints, index: sorted });
  const [[x0, y0], [x1, y1], z] = [box.low, box.high, linePoints[3 * lineFirst[closed[0]] + 2]];
  const square = shape({
    points: new Float32Array([x0 - 1, y0 - 1, z, x1 + 1, y0 - 1, z, x1 + 1, y1 + 1, z, x0 - 1, y1 + 1, z]), index: new Uint32Array([0, 1, 2, 0, 2, 3]),
  });
  const turning = put("part", solid(odd, { ...common, depthTest: false, stencil: "odd" }), -2);
  if (sorted.length > DETAIL.least) chains.push((tolerance) => { turning.draw.ranges = [[0, higher(tolerance)]]; });
  put("part", solid(square, { ...common, offset: [2, 2], stencil: "inside" }), -1);
}
sheet();

// Triangles of the part or of a fixture.
function surface(layer, name, points, faces) {
  put(layer, solid(shape({ points, index: unpack(faces, Uint32Array) }), { name, shine: 2, offset: [2, 2] }), 0);
}
if (data.solid) surface("part", "solid", solidPoints, data.solid.faces);
for (const [, { vertices, faces }] of data.meshes) surface("fixtures", "fixture", unpack(vertices), faces);

// The program's way. Segments carry their path, so that switching colours sends one number for each.
const wayGroup = Float32Array.from(track.event, (e) => (track.path[e] < 0 && track.kind[e] ? -0.75 : track.path[e]));
const stepOf = (s, k) => track.position[3 * s + k] - track.position[3 * s - 3 + k];
const stepSize = (s) => Math.hypot(stepOf(s, 0), stepOf(s, 1), stepOf(s, 2));

// Dashes run on through the pieces of a motion, and begin anew with every motion.
function travelledAt() {
  const found = new Float32Array(stations);
  for (let s = 1; s < stations; s++) found[s] = stepSize(s) + (track.event[s] === track.event[s - 1] ? found[s - 1] : 0);
  return found;
}
const SCALES = {
  order: { label: "Order", unit: "", of: (e) => track.path[e] },
  feed: { label: "Feed", unit: " mm/s", of: (e) => track.feed[e] },
  force: { label: "Force", unit: " N", of: (e) => track.force[e] },
};
for (const scale of Object.values(SCALES)) spanScale(scale);
function spanScale(scale) {
  scale.low = Infinity;
  scale.high = -Infinity;
  for (let e = 0; e < track.path.length; e++) {
    if (track.path[e] < 0) continue;
    scale.low = Math.min(scale.low, scale.of(e));
    scale.high = Math.max(scale.high, scale.of(e));
  }
}
SCALES.order.low = 0;
SCALES.order.high = Math.max(data.paths.length - 1, 0);

// Feeds and forces that look the same have the same key.
const SHADES = 48;
const shadeOf = ({ low, high, of }, e) => (high > low && track.path[e] >= 0 ? Math.round(((of(e) - low) / (high - low)) * SHADES) : 0);
const eventKeys = track.feed.map((_, e) => shadeOf(SCALES.feed, e) + 100 * shadeOf(SCALES.force, e));
const wayKey = Float32Array.from(track.event, (e) => eventKeys[e]);
const way = lines({
  points: track.position, group: wayGroup, key: wayKey, time: track.time, run: travelledAt(),
  width: 2.4, picks: 1, order: 3,
});
way.order = 4;
scene.parts.push(way);

// The path that the controller runs of the program, with the corners that it rounds.
function executedPath({ points: packed, counts }) {
  const points = unpack(packed);
  const group = new Float32Array(points.length / 3);
  let first = 0;
  for (const count of counts) {
    group[first] = -2;
    first += count;
  }
  put("executed", lines({ points, group, width: 1.6, order: 4 }), 5);
}
if (data.executed) executedPath(data.executed);

function colourBy(name) {
  const { low, high, of } = SCALES[name];
  const infos = way.draw.uniforms.infos.value;
  const place = (value) => (high > low ? Math.max((value - low) / (high - low), 0) : 0);
  for (let s = 1; s < stations; s++) infos.values[4 * s] = place(of(track.event[s]));
  infos.changed = [0, infos.high - 1];
}

// Arrows stand evenly along each path; one of two, of four ... stays where the picture is small.
function alongPaths() {
  const found = { arrows: [[], [], []], starts: [[], [], []], axes: [] };
  const length = new Float64Array(data.paths.length);
  for (const s of worked) length[track.path[track.event[s]]] += stepSize(s);
  const whole = length.reduce((a, b) => a + b, 0);
  const apart = Math.max(extent / 80, whole / 40000);
  const every = Math.max(1, Math.ceil(worked.length / 20000));
  let last = -1;
  let run = 0;
  worked.forEach((s, place) => {
    const path = track.path[track.event[s]];
    const size = stepSize(s);
    if (path !== last) {
      found.starts[0].push(...track.position.subarray(3 * s - 3, 3 * s));
      found.starts[1].push(0, 0, 0);
      found.starts[2].push(length[path]);
      run = 0;
      last = path;
    }
    if (place % every === 0) found.axes.push(s);
    if (!(size > 0)) return;
    const gap = Math.min(apart, length[path] / 2.001);
    for (let n = Math.ceil((run + 1e-9) / gap); n * gap <= run + size; n++) {
      const share = (n * gap - run) / size;
      const move = [0, 1, 2].map((k) => stepOf(s, k));
      found.arrows[0].push(...move.map((v, k) => track.position[3 * s - 3 + k] + v * share));
      found.arrows[1].push(...move.map((v) => v / size));
      found.arrows[2].push(Math.min(gap * (n & -n), length[path]));
    }
    run += size;
  });
  return found;
}
const along = alongPaths();
put("arrows", marks(...along.arrows, { radius: 6, least: 46, arrow: true }), 5);
// Among hundreds of paths a ring on each would hide them: it comes when they are looked at closely.
put("starts", marks(...along.starts, { radius: 4, least: data.paths.length > 400 ? 80 : 16, arrow: false }), 6);

function axes(chosen) {
  const points = new Float32Array(6 * chosen.length);
  const group = new Float32Array(2 * chosen.length).fill(-2);
  chosen.forEach((s, row) => {
    for (let k = 0; k < 3; k++) {
      points[6 * row + k] = track.position[3 * s + k];
      points[6 * row + 3 + k] = track.position[3 * s + k] - track.axis[3 * s + k] * extent * 0.06;
    }
    group[2 * row + 1] = 0;
  });
  return lines({ points, group, width: 1, opacity: 0.7 });
}
put("axes", axes(along.axes), 3);

function themed() {
  const uniforms = way.draw.uniforms;
  ramp().forEach((colour, k) => { shared[["low", "middle", "high"][k]].value = colour.map((v) => v / 255); });
  shared.pickColour.value = colourOf(css("pick"));
  uniforms.other.value = colourOf(css("travel"));
  uniforms.near.value = colourOf(css("near"));
  uniforms.back.value = colourOf(css("scene"));
  for (const layer of Object.values(layers)) {
    const own = colourOf(css(layer.colour));
    for (const { draw, name } of layer.things) {
      if (!draw || NAMED.includes(name)) continue;
      if (draw.uniforms.colour) draw.uniforms.colour.value = own;
      if (draw.uniforms.back) draw.uniforms.back.value = uniforms.back.value;
    }
  }
  cutting.shown?.theme();
}

function showLayers() {
  for (const layer of Object.values(layers)) layer.things.forEach((thing) => { thing.visible = !layer.off; });
  way.draw.uniforms.work.value = layers.paths.off ? 0 : 1;
  way.draw.uniforms.travel.value = layers.travel.off ? 0 : 1;
  way.draw.uniforms.approach.value = layers.approach.off ? 0 : 1;
}
