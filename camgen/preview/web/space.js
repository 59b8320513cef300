// Points and directions are three numbers, matrices sixteen by columns, as WebGL takes them. None is changed in place.
const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
// From `a` so far along `way`.
const onward = (a, way, run) => [a[0] + run * way[0], a[1] + run * way[1], a[2] + run * way[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const sizeOf = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scaled(a, 1 / (sizeOf(a) || 1));
const axisOf = (k) => [0, 1, 2].map((i) => Number(i === k));

const HERE = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
// From three columns and where the origin goes.
const framed3 = (x, y, z, at) => [...x, 0, ...y, 0, ...z, 0, ...at, 1];
const moveBy = (at) => framed3(axisOf(0), axisOf(1), axisOf(2), at);
const columnOf = (m, k) => [m[4 * k], m[4 * k + 1], m[4 * k + 2]];
const placeOf = (m) => columnOf(m, 3);

// Of a pose: the rotation by rows, then the origin.
function matrixOf(pose) {
  const [a, b, c, d, e, f, g, h, i, ...at] = pose;
  return framed3([a, d, g], [b, e, h], [c, f, i], at);
}

function product(a, b) {
  const found = new Array(16);
  for (let k = 0; k < 16; k += 4) {
    for (let i = 0; i < 4; i++) {
      found[k + i] = a[i] * b[k] + a[i + 4] * b[k + 1] + a[i + 8] * b[k + 2] + a[i + 12] * b[k + 3];
    }
  }
  return found;
}

// Of a matrix whose columns are square to each other and one long: a rotation and a move.
function inverse(m) {
  const [x, y, z, at] = [0, 1, 2, 3].map((k) => columnOf(m, k));
  return framed3([x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]], [-dot(x, at), -dot(y, at), -dot(z, at)]);
}

const turned = (m, way) => [0, 1, 2].map((i) => m[i] * way[0] + m[i + 4] * way[1] + m[i + 8] * way[2]);
const moved = (m, at) => plus(turned(m, at), placeOf(m));

// A turn about an axis of length one.
function turnAbout(axis, angle) {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  const columns = [0, 1, 2].map((k) => {
    const own = axisOf(k);
    return onward(onward(scaled(own, c), axis, axis[k] * (1 - c)), cross(axis, own), s);
  });
  return framed3(...columns, [0, 0, 0]);
}

// The least turn from one direction to another, both of length one.
function turnTo3(from, to) {
  const axis = cross(from, to);
  if (sizeOf(axis) > 1e-9) return turnAbout(unit(axis), Math.atan2(sizeOf(axis), dot(from, to)));
  const beside = cross(from, axisOf(Math.abs(from[0]) < 0.9 ? 0 : 1));
  return dot(from, to) > 0 ? HERE : turnAbout(unit(beside), Math.PI);
}
