// Large drawings with as much detail as can be seen: chains without the points that lie on a line within a tolerance, and
// only those pieces of them that are in the picture.
const DETAIL = { least: 5000, piece: 512, window: 64, worth: 0.7 };

// The rows of a chain that are kept where none that is left out is farther than `tolerance` (mm) from the line between
// those beside it. Rows at which `group` or `key` changes are kept: a segment has one of each.
function thinned(points, group, key, tolerance) {
  const count = points.length / 3;
  const kept = new Uint32Array(count);
  const square = tolerance * tolerance;
  let [n, from] = [1, 0];
  const reaches = (to) => {
    const [ax, ay, az] = [points[3 * from], points[3 * from + 1], points[3 * from + 2]];
    const [dx, dy, dz] = [points[3 * to] - ax, points[3 * to + 1] - ay, points[3 * to + 2] - az];
    const long = dx * dx + dy * dy + dz * dz;
    for (let j = to - 1; j > from; j--) {
      const [x, y, z] = [points[3 * j] - ax, points[3 * j + 1] - ay, points[3 * j + 2] - az];
      const share = long > 0 ? Math.min(Math.max((x * dx + y * dy + z * dz) / long, 0), 1) : 0;
      const [u, v, w] = [x - share * dx, y - share * dy, z - share * dz];
      if (u * u + v * v + w * w > square) return false;
    }
    return true;
  };
  for (let i = 1; i < count; i++) {
    const ends = i === count - 1 || group[i + 1] !== group[i] || (key && key[i + 1] !== key[i]);
    if (!ends && i - from < DETAIL.window && reaches(i + 1)) continue;
    kept[n++] = i;
    from = i;
  }
  return kept.subarray(0, n);
}

// Balls around pieces of so many segments: place and radius (Float32Array, four numbers each). rows: of the chain, all
// where there are none.
function pieceBalls(points, rows) {
  const segments = (rows ? rows.length : points.length / 3) - 1;
  const balls = new Float32Array(4 * Math.ceil(segments / DETAIL.piece));
  for (let piece = 0; 4 * piece < balls.length; piece++) {
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    const last = Math.min((piece + 1) * DETAIL.piece, segments);
    for (let k = piece * DETAIL.piece; k <= last; k++) {
      const at = 3 * (rows ? rows[k] : k);
      for (let i = 0; i < 3; i++) {
        const v = points[at + i];
        if (v < low[i]) low[i] = v;
        if (v > high[i]) high[i] = v;
      }
    }
    balls.set([...scaled(plus(low, high), 0.5), sizeOf(minus(high, low)) / 2], 4 * piece);
  }
  return balls;
}

// Row numbers as texels, four in each.
function rowTable(rows) {
  const high = Math.max(Math.ceil(rows.length / (4 * WIDE)), 1);
  const values = new Float32Array(4 * WIDE * high);
  values.set(rows);
  return table(values, WIDE, high);
}

// A chain's levels of detail, each made when it is first seen. From where thinning gains little on, all rows are drawn.
function levelsOf({ points, group, key, draw }) {
  const segments = Math.max(points.length / 3 - 1, 0);
  const whole = { rows: null, segments, balls: null };
  const made = new Map();
  let finest = -Infinity;
  const levelAt = (step) => {
    if (segments < DETAIL.least || step <= finest) return whole;
    if (!made.has(step)) {
      const rows = thinned(points, group, key, 2 ** step);
      if (rows.length > DETAIL.worth * segments) {
        finest = step;
        return whole;
      }
      made.set(step, { rows, table: rowTable(rows), segments: rows.length - 1, balls: null });
    }
    return made.get(step);
  };
  // tolerance: mm. isSeen: of a ball.
  return (tolerance, isSeen) => {
    const level = levelAt(Math.floor(Math.log2(tolerance)));
    draw.uniforms.rows.value = level.table ?? draw.uniforms.stations.value;
    draw.uniforms.picked.value = level.rows ? 1 : 0;
    if (segments < DETAIL.least) return;
    level.balls ??= pieceBalls(points, level.rows);
    draw.ranges = [];
    for (let piece = 0; 4 * piece < level.balls.length; piece++) {
      if (!isSeen(level.balls, 4 * piece)) continue;
      const [from, to] = [piece * DETAIL.piece, Math.min((piece + 1) * DETAIL.piece, level.segments)];
      const last = draw.ranges.at(-1);
      if (last && last[1] === 6 * from) last[1] = 6 * to;
      else draw.ranges.push([6 * from, 6 * to]);
    }
  };
}

// Triangles of a sheet, those that stand out most first: of the others only so many are drawn as are seen. Gives the
// index in that order, and how many of its corners stand out more than a tolerance (mm).
function byHeight(points, index) {
  const count = index.length / 3;
  const steps = new Int8Array(count);
  const ends = new Uint32Array(256);
  const corner = (k) => [points[3 * index[k]], points[3 * index[k] + 1]];
  for (let k = 0; k < count; k++) {
    const [[ax, ay], [bx, by], [cx, cy]] = [corner(3 * k), corner(3 * k + 1), corner(3 * k + 2)];
    const area = Math.abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax));
    const long = Math.max(Math.hypot(bx - ax, by - ay), Math.hypot(cx - bx, cy - by), Math.hypot(ax - cx, ay - cy));
    steps[k] = area > 0 ? Math.min(Math.max(Math.ceil(Math.log2(area / long)), -100), 100) : -100;
    ends[100 - steps[k]]++;
  }
  for (let k = 1; k < 256; k++) ends[k] += ends[k - 1];
  const at = Uint32Array.from(ends, (_, k) => (k ? ends[k - 1] : 0));
  const sorted = new Uint32Array(index.length);
  for (let k = 0; k < count; k++) {
    const place = at[100 - steps[k]]++;
    for (let i = 0; i < 3; i++) sorted[3 * place + i] = index[3 * k + i];
  }
  // In a step are heights up to the power of two.
  const higher = (tolerance) => 3 * ends[Math.min(Math.max(100 - Math.floor(Math.log2(tolerance)) - 1, 0), 255)];
  return { sorted, higher };
}
