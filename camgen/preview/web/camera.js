// One camera without perspective, so that lengths compare; turned, moved and zoomed by mouse, touch and keys.
// right, up, ahead: directions in the scene, the last towards the viewer. whole: from the scene to the picture.
const camera = { right: [1, 0, 0], up: [0, 1, 0], ahead: [0, 0, 1], whole: HERE };
// whole: with the robot. begun: as the page began. own: moved or zoomed by hand, which a new size of the window leaves.
const look = { target: [0, 0, 0], turn: -0.9, tilt: 0.6, height: 1, whole: false, begun: false, own: false };
let stale = true;
function redraw() {
  stale = true;
  wake();
}

canvas.addEventListener("webglcontextrestored", redraw);

if (!gl) {
  $("hint").hidden = false;
  $("hint").textContent = "This browser shows no 3-D pictures (WebGL is off). The list and the numbers work.";
}

function corners(whole) {
  const found = [];
  for (let k = 0; k < 8; k++) found.push([0, 1, 2].map((i) => (k >> i & 1 ? box.high[i] : box.low[i])));
  if (!whole || !arm) return found;
  arm.links3.forEach((link, n) => {
    arm.links[n][1].forEach(([pose, half]) => {
      const placed = product(link.matrix, matrixOf(pose));
      for (let k = 0; k < 8; k++) found.push(moved(placed, half.map((v, i) => (k >> i & 1 ? v : -v))));
    });
    found.push(placeOf(link.matrix));
  });
  return found;
}

function aim() {
  const { target, turn, tilt } = look;
  const far = 40 * Math.max(extent, 3000);
  const ahead = [Math.cos(tilt) * Math.cos(turn), Math.cos(tilt) * Math.sin(turn), Math.sin(tilt)];
  // Straight from above "up" is y.
  const up = [-Math.sin(tilt) * Math.cos(turn), -Math.sin(tilt) * Math.sin(turn), Math.cos(tilt)];
  const right = cross(up, ahead);
  const [wide, high] = [look.height * (canvas.clientWidth / Math.max(canvas.clientHeight, 1)), look.height];
  const rows = [scaled(right, 2 / wide), scaled(up, 2 / high), scaled(ahead, -2 / far)];
  const columns = [0, 1, 2].map((k) => rows.map((row) => row[k]));
  Object.assign(camera, { right, up, ahead, whole: framed3(...columns, rows.map((row) => -dot(row, target))) });
  shared.deep.value = 2 / far;
  shared.lift.value = (0.001 * extent) / far;
  shared.perMm.value = canvas.clientHeight / look.height;
  shared.light.value = unit(plus(onward(scaled(ahead, 1 / 2), right, -1 / 8), [0, 0, 1 / 6]));
  redraw();
}

function fit(whole = look.whole) {
  [look.whole, look.begun, look.own] = [whole, false, false];
  const found = corners(whole);
  aim();
  const spans = [camera.right, camera.up].map((axis) => {
    const along_ = found.map((corner) => dot(corner, axis));
    return [Math.min(...along_), Math.max(...along_), axis];
  });
  look.target = scaled(camera.ahead, found.reduce((sum, corner) => sum + dot(corner, camera.ahead), 0) / found.length);
  for (const [low, high, axis] of spans) look.target = onward(look.target, axis, (low + high) / 2);
  const [wide, high] = spans.map(([a, b]) => Math.max(b - a, 1e-6));
  // Legend and scale stand below.
  const [above, below] = [28, 96];
  const room = [Math.max(canvas.clientWidth - 48, 50), Math.max(canvas.clientHeight - above - below, 50)];
  const per = Math.max(wide / room[0], high / room[1]);
  look.height = per * canvas.clientHeight;
  look.target = onward(look.target, camera.up, (per * (above - below)) / 2);
  aim();
}

// What is seen first: all of the part, and all of the robot where there is one.
function begin() {
  fit(Boolean(arm));
  look.begun = true;
}

// The oblique view looks over the part at the robot, which would hide it from behind.
function oblique() {
  if (!arm) return -1.05;
  const base = placeOf(arm.base);
  const [x, y] = [0, 1].map((k) => (box.low[k] + box.high[k]) / 2);
  return Math.atan2(y - base[1], x - base[0]) - 0.75;
}

const VIEWS = { top: [-Math.PI / 2, Math.PI / 2], side: [-Math.PI / 2, 0], iso: [oblique(), 0.5] };
function turnTo(name) {
  [look.turn, look.tilt] = VIEWS[name];
  fit();
}

function zoom(factor, x, y) {
  const area = canvas.getBoundingClientRect();
  const per = look.height / area.height;
  const [dx, dy] = [(x - area.left - area.width / 2) * per, (area.height / 2 - y + area.top) * per];
  const height = Math.min(Math.max(look.height * factor, extent * 1e-4), Math.max(extent, 3000) * 20);
  const kept = 1 - height / look.height;
  look.target = onward(onward(look.target, camera.right, dx * kept), camera.up, dy * kept);
  look.height = height;
  look.own = true;
  aim();
}

function shift(dx, dy) {
  const per = look.height / canvas.clientHeight;
  look.target = onward(onward(look.target, camera.right, -dx * per), camera.up, dy * per);
  look.own = true;
  aim();
}

function orbit(dx, dy) {
  look.turn -= dx * 0.008;
  look.tilt = Math.min(Math.max(look.tilt + dy * 0.008, -Math.PI / 2), Math.PI / 2);
  aim();
}

// One finger or the left button turns, two fingers or another button move; a press that does not move is a click.
const held = new Map();
let dragged = 0;
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  held.set(event.pointerId, [event.clientX, event.clientY]);
  dragged = held.size > 1 ? 99 : 0;
});
canvas.addEventListener("pointermove", (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
  dragged += Math.abs(dx) + Math.abs(dy);
  if (held.size === 2) {
    const other = [...held].find(([id]) => id !== event.pointerId)[1];
    const gap = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
    shift(dx / 2, dy / 2);
    const now = gap([event.clientX, event.clientY]);
    if (now > 1) zoom(gap(before) / now, (event.clientX + other[0]) / 2, (event.clientY + other[1]) / 2);
  } else if (dragged > 4) {
    (event.buttons > 1 || event.shiftKey ? shift : orbit)(dx, dy);
  }
  held.set(event.pointerId, [event.clientX, event.clientY]);
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => held.delete(event.pointerId));
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(Math.min(Math.max(event.deltaY, -240), 240) * 0.0016), event.clientX, event.clientY);
}, { passive: false });
