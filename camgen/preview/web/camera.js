// One camera without perspective, so that lengths compare; turned, moved and zoomed by mouse, touch and keys.
const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0, 1);
camera.up.set(0, 0, 1);
// whole: with the robot. begun: as the page began. own: moved or zoomed by hand, which a new size of the window leaves.
const look = { target: new THREE.Vector3(), turn: -0.9, tilt: 0.6, height: 1, whole: false, begun: false, own: false };
const canvas = $("canvas");
let renderer = null;
let stale = true;
const redraw = () => { stale = true; };

function makeRenderer() {
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true, stencil: true });
  } catch {
    $("hint").hidden = false;
    $("hint").textContent = "This browser shows no 3-D pictures (WebGL is off). The list and the numbers work.";
  }
}

function corners(whole) {
  const found = [];
  for (let k = 0; k < 8; k++) found.push(new THREE.Vector3(...[0, 1, 2].map((i) => (k >> i & 1 ? box.high[i] : box.low[i]))));
  if (!whole || !arm) return found;
  arm.links3.forEach((link, n) => {
    arm.links[n][1].forEach(([pose, half]) => {
      const placed = new THREE.Matrix4().multiplyMatrices(link.matrix, matrixOf(pose));
      for (let k = 0; k < 8; k++) found.push(new THREE.Vector3(...half.map((v, i) => (k >> i & 1 ? v : -v))).applyMatrix4(placed));
    });
    found.push(new THREE.Vector3().setFromMatrixPosition(link.matrix));
  });
  return found;
}

function aim() {
  const { target, turn, tilt } = look;
  const far = 40 * Math.max(extent, 3000);
  const from = [Math.cos(tilt) * Math.cos(turn), Math.cos(tilt) * Math.sin(turn), Math.sin(tilt)];
  camera.position.set(...from).multiplyScalar(far / 2).add(target);
  // Straight from above "up" is y.
  camera.up.set(-Math.sin(tilt) * Math.cos(turn), -Math.sin(tilt) * Math.sin(turn), Math.cos(tilt));
  camera.lookAt(target);
  const aspect = canvas.clientWidth / Math.max(canvas.clientHeight, 1);
  [camera.top, camera.bottom] = [look.height / 2, -look.height / 2];
  [camera.right, camera.left] = [camera.top * aspect, -camera.top * aspect];
  [camera.near, camera.far] = [0, far];
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  shared.deep.value = 2 / far;
  shared.lift.value = (0.001 * extent) / far;
  shared.perMm.value = canvas.clientHeight / look.height;
  lights[1].position.copy(camera.position).sub(target).add(new THREE.Vector3(0, 0, far / 6)).addScaledVector(rightOf(), -far / 8);
  redraw();
}

const rightOf = () => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 0);
const upOf = () => new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 1);

function fit(whole = look.whole) {
  [look.whole, look.begun, look.own] = [whole, false, false];
  const found = corners(whole);
  aim();
  const spans = [rightOf(), upOf()].map((axis) => {
    const along_ = found.map((corner) => corner.dot(axis));
    return [Math.min(...along_), Math.max(...along_), axis];
  });
  const ahead = new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 2);
  const middle = found.reduce((sum, corner) => sum + corner.dot(ahead), 0) / found.length;
  look.target.copy(ahead).multiplyScalar(middle);
  for (const [low, high, axis] of spans) look.target.addScaledVector(axis, (low + high) / 2);
  const [wide, high] = spans.map(([a, b]) => Math.max(b - a, 1e-6));
  // Legend and scale stand below.
  const [above, below] = [28, 96];
  const room = [Math.max(canvas.clientWidth - 48, 50), Math.max(canvas.clientHeight - above - below, 50)];
  const per = Math.max(wide / room[0], high / room[1]);
  look.height = per * canvas.clientHeight;
  look.target.addScaledVector(upOf(), (per * (above - below)) / 2);
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
  const base = new THREE.Vector3().setFromMatrixPosition(arm.base);
  const [x, y] = [0, 1].map((k) => (box.low[k] + box.high[k]) / 2);
  return Math.atan2(y - base.y, x - base.x) - 0.75;
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
  look.target.addScaledVector(rightOf(), dx * kept).addScaledVector(upOf(), dy * kept);
  look.height = height;
  look.own = true;
  aim();
}

function shift(dx, dy) {
  const per = look.height / canvas.clientHeight;
  look.target.addScaledVector(rightOf(), -dx * per).addScaledVector(upOf(), dy * per);
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
