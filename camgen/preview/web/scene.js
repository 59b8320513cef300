// What stands in the work frame: part, paths, starts, arrows, tool axes. Coordinates are told from `origin`.
const scene = new THREE.Scene();
// What plays the cut and what shows it: stock.js, which only pages of jobs that cut have.
const cutting = { stock: null, shown: null, tool: null };
// What changes the order and the seams of paths: edit.js, which only pages of the workbench have.
const edits = {};
const box = { low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] };

function grow(points) {
  for (let i = 0; i < points.length; i++) {
    const k = i % 3;
    if (points[i] < box.low[k]) box.low[k] = points[i];
    if (points[i] > box.high[k]) box.high[k] = points[i];
  }
}

const solidPoints = data.solid ? unpack(data.solid.vertices) : null;
if (solidPoints) grow(solidPoints);
grow(linePoints);
if (data.stock) [data.stock.low, data.stock.high].forEach(grow);
// The way from home may be far away: only what is worked on counts for the size of the picture.
const worked = [];
for (let s = 1; s < stations; s++) {
  if (track.path[track.event[s]] >= 0) worked.push(s);
}
for (const s of worked) grow(track.position.subarray(3 * s, 3 * s + 3));
if (box.low[0] > box.high[0]) grow(track.position);
const extent = Math.max(Math.hypot(...box.high.map((v, k) => v - box.low[k])), 1e-3);
const isFlat = data.flat;

// Layers: name, colour in the style sheet, the things that are shown.
const layers = {
  stock: { label: "Stock", colour: "stock", things: [] },
  photo: { label: "Picture", colour: "unused", things: [] },
  part: { label: "Part", colour: "part", things: [] },
  skipped: { label: "Left out", colour: "bad", things: [] },
  fixtures: { label: data.standing.some(([name]) => name === "table") ? "Table" : "Fixtures", colour: "fixture", things: [] },
  unused: { label: "Not asked for", colour: "unused", things: [] },
  numbers: { label: "Numbers", colour: "accent", things: [] },
  paths: { label: "Tool paths", colour: "accent", things: [] },
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

function put(layer, thing, order) {
  thing.renderOrder = order;
  scene.add(thing);
  layers[layer].things.push(thing);
  return thing;
}

// Contours and edges, one mesh for each state.
const STATES = { done: ["part", 1.4], skipped: ["skipped", 2.2], wrong: ["skipped", 4], noted: ["part", 2.5], unused: ["unused", 1.2] };
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

// The sheet inside closed contours, even-odd: every fan turns the stencil over, a square fills what is left odd.
function sheet() {
  const closed = data.lines.rows.flatMap((line, k) => (line.closed && line.state !== "unused" ? [k] : []));
  if (!isFlat || !closed.length) return;
  const index = [];
  for (const k of closed) {
    for (let i = 1; i < data.lines.counts[k] - 1; i++) index.push(lineFirst[k], lineFirst[k] + i, lineFirst[k] + i + 1);
  }
  const fans = new THREE.BufferGeometry();
  fans.setAttribute("position", new THREE.BufferAttribute(linePoints, 3));
  fans.setIndex(index);
  const common = { side: THREE.DoubleSide, depthWrite: false, transparent: true, stencilWrite: true };
  const odd = new THREE.Mesh(fans, new THREE.MeshBasicMaterial({
    ...common, colorWrite: false, depthTest: false, stencilFunc: THREE.AlwaysStencilFunc,
    stencilFail: THREE.InvertStencilOp, stencilZFail: THREE.InvertStencilOp, stencilZPass: THREE.InvertStencilOp,
    stencilWriteMask: 1,
  }));
  const square = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), new THREE.MeshBasicMaterial({
    ...common, stencilFunc: THREE.NotEqualStencilFunc, stencilRef: 0, stencilFuncMask: 1,
    stencilZPass: THREE.KeepStencilOp, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2,
  }));
  square.scale.set(box.high[0] - box.low[0] + 1, box.high[1] - box.low[1] + 1, 1);
  square.position.set((box.low[0] + box.high[0]) / 2, (box.low[1] + box.high[1]) / 2, linePoints[3 * lineFirst[closed[0]] + 2]);
  odd.frustumCulled = false;
  [odd.name, square.name] = ["plate", "plate"];
  put("part", odd, -2);
  put("part", square, -1);
}
sheet();

// Triangles of the part or of a fixture.
function surface(layer, name, points, faces) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
  geometry.setIndex(new THREE.BufferAttribute(unpack(faces, Uint32Array), 1));
  const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({
    flatShading: true, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2,
  }));
  mesh.name = name;
  put(layer, mesh, 0);
}
if (data.solid) surface("part", "solid", solidPoints, data.solid.faces);
for (const [, { vertices, faces }] of data.meshes) surface("fixtures", "fixture", unpack(vertices), faces);

// The program's way. Segments carry their path, so that switching colours sends one number for each.
const wayGroup = Float32Array.from(track.event, (e) => (track.path[e] < 0 && track.kind[e] ? -0.75 : track.path[e]));
const travelled = new Float32Array(stations);
for (let s = 1; s < stations; s++) {
  // Dashes run on through the pieces of a motion, and begin anew with every motion.
  const size = Math.hypot(...[0, 1, 2].map((k) => track.position[3 * s + k] - track.position[3 * s - 3 + k]));
  travelled[s] = size + (track.event[s] === track.event[s - 1] ? travelled[s - 1] : 0);
}
const way = lines({
  points: track.position, group: wayGroup, time: track.time, run: travelled,
  width: 2.4, picks: 1, order: 3,
});
way.renderOrder = 4;
scene.add(way);

const SCALES = {
  order: { label: "Order", unit: "", of: (e) => track.path[e] },
  feed: { label: "Feed", unit: " mm/s", of: (e) => track.feed[e] },
  force: { label: "Force", unit: " N", of: (e) => track.force[e] },
};
for (const scale of Object.values(SCALES)) {
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

function colourBy(name) {
  const { low, high, of } = SCALES[name];
  const infos = way.material.uniforms.infos.value;
  const place = (value) => (high > low ? Math.max((value - low) / (high - low), 0) : 0);
  for (let s = 1; s < stations; s++) infos.image.data[4 * s] = place(of(track.event[s]));
  infos.needsUpdate = true;
}

// Arrows stand evenly along each path; one of two, of four ... stays where the picture is small.
function alongPaths() {
  const found = { arrows: [[], [], []], starts: [[], [], []], axes: [] };
  const length = new Float64Array(data.paths.length);
  const step = (s, k) => track.position[3 * s + k] - track.position[3 * s - 3 + k];
  for (const s of worked) length[track.path[track.event[s]]] += Math.hypot(step(s, 0), step(s, 1), step(s, 2));
  const whole = length.reduce((a, b) => a + b, 0);
  const apart = Math.max(extent / 80, whole / 40000);
  const every = Math.max(1, Math.ceil(worked.length / 20000));
  let last = -1;
  let run = 0;
  worked.forEach((s, place) => {
    const path = track.path[track.event[s]];
    const from = [0, 1, 2].map((k) => track.position[3 * s - 3 + k]);
    const move = [0, 1, 2].map((k) => step(s, k));
    const size = Math.hypot(...move);
    if (path !== last) {
      found.starts[0].push(...from);
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
      found.arrows[0].push(...from.map((v, k) => v + move[k] * share));
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

const lights = [new THREE.HemisphereLight(0xffffff, 0xa3adba, 2.3), new THREE.DirectionalLight(0xffffff, 1.3)];
scene.add(...lights);

function themed() {
  const set = (uniform, text) => uniform.value.set(text).convertLinearToSRGB();
  const stops = ramp().map(rgb);
  [shared.low, shared.middle, shared.high].forEach((uniform, k) => set(uniform, stops[k]));
  set(shared.pickColour, css("pick"));
  set(way.material.uniforms.other, css("travel"));
  set(way.material.uniforms.near, css("near"));
  set(way.material.uniforms.back, css("scene"));
  for (const layer of Object.values(layers)) {
    for (const { material, name } of layer.things) {
      if (!material) continue;
      if (material.uniforms?.colour) set(material.uniforms.colour, css(layer.colour));
      if (material.uniforms?.back) set(material.uniforms.back, css("scene"));
      if (name === "plate" || name === "solid") material.color.set(css(name));
      if (name === "gouge" || name === "excess") material.color.set(css(layer.colour));
    }
  }
  cutting.shown?.theme();
}

function showLayers() {
  for (const layer of Object.values(layers)) layer.things.forEach((thing) => { thing.visible = !layer.off; });
  way.material.uniforms.work.value = layers.paths.off ? 0 : 1;
  way.material.uniforms.travel.value = layers.travel.off ? 0 : 1;
  way.material.uniforms.approach.value = layers.approach.off ? 0 : 1;
}
