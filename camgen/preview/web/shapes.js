// Shapes that an arm is told by: rounded bodies about the cuboids of its links, housings about its joints. They are a
// picture; what is tested for collisions are the cuboids, which a layer shows.

// A cuboid as a plate: round in the plane of its two longer sides by the radius `round`, its rims by `rim`. The thinnest
// side is z.
function roundedPlate([u, v, h], round, rim) {
  const [turns, rings] = [8, 5];
  const points = [];
  const normals = [];
  const index = [];
  const outline = [];
  for (const [k, [x, y]] of [[1, 1], [-1, 1], [-1, -1], [1, -1]].entries()) {
    for (let i = 0; i <= turns; i++) {
      const angle = (Math.PI / 2) * (k + i / turns);
      outline.push([x * (u - round), y * (v - round), Math.cos(angle), Math.sin(angle)]);
    }
  }
  const levels = [];
  for (const side of [-1, 1]) {
    for (let i = 0; i <= rings; i++) levels.push([side, (Math.PI / 2) * (side < 0 ? 1 - i / rings : i / rings)]);
  }
  const count = outline.length;
  for (const [side, bend] of levels) {
    const out = round - rim + rim * Math.cos(bend);
    for (const [x, y, dx, dy] of outline) {
      points.push(x + out * dx, y + out * dy, side * (h - rim + rim * Math.sin(bend)));
      normals.push(dx * Math.cos(bend), dy * Math.cos(bend), side * Math.sin(bend));
    }
  }
  for (let j = 0; j + 1 < levels.length; j++) {
    for (let i = 0; i < count; i++) {
      const [k, n] = [j * count + i, j * count + ((i + 1) % count)];
      index.push(k, n, n + count, k, n + count, k + count);
    }
  }
  // The flat ends, each from its middle.
  for (const [first, side] of [[0, -1], [(levels.length - 1) * count, 1]]) {
    const middle = points.length / 3;
    points.push(0, 0, side * h);
    normals.push(0, 0, side);
    for (let i = 0; i < count; i++) {
      const [k, n] = [first + i, first + ((i + 1) % count)];
      index.push(...(side > 0 ? [middle, k, n] : [middle, n, k]));
    }
  }
  return shape({ points: new Float32Array(points), normals: new Float32Array(normals), index: new Uint32Array(index) });
}

// A cuboid as a body: a bar or a plate with round ends, its rims as round as it is thin.
function body([pose, half], name) {
  const thin = half.indexOf(Math.min(...half));
  const order = [(thin + 1) % 3, (thin + 2) % 3, thin];
  const [u, v, h] = order.map((k) => Math.max(half[k], 1e-3));
  const made = solid(roundedPlate([u, v, h], 0.92 * Math.min(u, v), 0.5 * h), { name, oneSided: true, ...PUSHED });
  made.matrix = product(matrixOf(pose), framed3(...order.map(axisOf), [0, 0, 0]));
  return made;
}

// Of a cuboid that the line through `at` along `axis` passes: half its length along it, half its least width across, and
// how far from `at` its middle is along the line; none where the line misses it.
function boxOnAxis([pose, half], at, axis) {
  const turn = inverse(matrixOf(pose));
  const from = moved(turn, at);
  const way = turned(turn, axis);
  const main = way.map(Math.abs).indexOf(Math.max(...way.map(Math.abs)));
  const across = [0, 1, 2].filter((k) => k !== main);
  // Where the line is at the height of the middle.
  const run = -from[main] / way[main];
  const off = across.map((k) => Math.abs(from[k] + way[k] * run));
  if (off.some((gap, i) => gap > 0.7 * half[across[i]])) return null;
  return { long: half[main], wide: Math.min(...across.map((k, i) => half[k] - 0.4 * off[i])), run };
}

// The housing of a joint about its axis, in the frame of the link that it moves: through the cuboids that the axis
// passes there, of that link and of the one before, and a little out of them on both sides.
function housing(at, axis, own, before) {
  const near = (found) => found && Math.abs(found.run) < 1.5 * found.long + found.wide;
  const hits = [...own, ...before].map((one) => boxOnAxis(one, at, axis)).filter(near);
  if (!hits.length) return null;
  const radius = 0.8 * Math.min(...hits.map(({ wide }) => wide));
  const out = 0.08 * radius;
  const ends = [
    Math.min(...hits.map(({ run, long }) => run - long)) - out, Math.max(...hits.map(({ run, long }) => run + long)) + out,
  ].map((run) => onward(at, axis, run));
  return rod(...ends, radius, radius, "arm-joint");
}

const distanceTo = ([pose, half], point) => {
  const own = moved(inverse(matrixOf(pose)), point);
  return Math.hypot(...own.map((v, k) => Math.max(Math.abs(v) - half[k], 0)));
};

// What one link looks like, in its frame. entry, exit: joints that it hangs on and that hangs on it: place, axis,
// whether it slides; none at the ends of the chain. before: cuboids of the link before, in this one's frame.
function linkShapes(boxes, entry, exit, before) {
  const found = boxes.map((one) => body(one, "arm"));
  const least = Math.min(...boxes.map(([, half]) => Math.min(...half)), ...before.map(([, half]) => Math.min(...half)));
  const thick = Number.isFinite(least) ? least : arm.size / 25;
  if (entry && !entry.sliding) found.push(housing(entry.at, entry.axis, boxes, before));
  if (entry && exit) {
    const way = minus(exit.at, entry.at);
    const middle = onward(entry.at, way, 0.5);
    // A gap between two joints that no cuboid fills.
    const bare = boxes.every((one) => distanceTo(one, middle) > 0.2 * thick);
    if (sizeOf(way) > thick && bare && !exit.sliding) found.push(rod(entry.at, exit.at, thick * 0.9, thick * 0.75, "arm"));
  }
  return found.filter(Boolean);
}

// The triangles of a link, where its description has them.
function linkMesh({ vertices, faces }) {
  return solid(shape({ points: unpack(vertices), index: unpack(faces, Uint32Array) }), { name: "arm", shine: 2, ...PUSHED });
}
