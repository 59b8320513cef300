// In the workbench alone: the start of a closed path is dragged along it, rows of the list are dragged to other places.
// What the user wants goes out to the page around this one; the next program shows it.
const SEAM_NEAR = 0.01;
const seam = { loop: null, at: 0, moved: false, timer: 0, handle: make("button", "", "seam") };

// The stations of path k once round, from where it begins: without leads, and of several passes one.
function loopOf(k) {
  const from = data.edits.seams[k];
  if (!from) return null;
  const points = [];
  let away = false;
  for (let s = 1; s < stations; s++) {
    if (track.path[track.event[s]] !== k) continue;
    for (const i of points.length ? [s] : [s - 1, s]) {
      const here = track.position.subarray(3 * i, 3 * i + 3);
      const near = Math.hypot(here[0] - from[0], here[1] - from[1]) < SEAM_NEAR;
      if (near && away) return closeLoop([...points, ...from]);
      if (!points.length && !near) continue;
      away ||= !near;
      points.push(here[0], here[1], from[2]);
    }
  }
  return points.length > 6 ? closeLoop(points) : null;
}

function closeLoop(points) {
  const lengths = [0];
  for (let i = 3; i < points.length; i += 3) {
    lengths.push(lengths.at(-1) + Math.hypot(points[i] - points[i - 3], points[i + 1] - points[i - 2]));
  }
  return { points, lengths, whole: lengths.at(-1) };
}

// The place `at` mm along the loop.
function placeOn({ points, lengths, whole }, at) {
  const wanted = ((at % whole) + whole) % whole;
  const i = Math.min(indexAt(lengths, wanted), lengths.length - 2);
  const part = (wanted - lengths[i]) / Math.max(lengths[i + 1] - lengths[i], 1e-9);
  return [0, 1, 2].map((n) => points[3 * i + n] + part * (points[3 * i + 3 + n] - points[3 * i + n]));
}

// How far along the loop is nearest to a place on the screen, mm.
function nearestOn({ points, lengths }, x, y) {
  setScreen();
  let best = { gap: Infinity, at: 0 };
  for (let i = 0; i + 1 < lengths.length; i++) {
    const [a, b] = [toScreen(points, i), toScreen(points, i + 1)];
    const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
    const run = dx * dx + dy * dy;
    const part = run > 0 ? Math.min(Math.max(((x - a[0]) * dx + (y - a[1]) * dy) / run, 0), 1) : 0;
    const gap = Math.hypot(a[0] + part * dx - x, a[1] + part * dy - y);
    if (gap < best.gap) best = { gap, at: lengths[i] + part * (lengths[i + 1] - lengths[i]) };
  }
  return best.at;
}

// The ring stands where the chosen path begins, or where it is dragged to.
function paintSeam() {
  const { handle, loop } = seam;
  handle.hidden = !loop || Boolean(layers.paths.off);
  if (handle.hidden) return;
  setScreen();
  const [x, y] = toScreen(placeOn(loop, seam.at), 0);
  handle.style.left = `${x}px`;
  handle.style.top = `${y}px`;
  handle.setAttribute("aria-valuetext", `${number(seam.at)} of ${number(loop.whole)} mm along path ${chosen.path + 1}`);
}

function chooseSeam(k) {
  clearTimeout(seam.timer);
  Object.assign(seam, { loop: k < 0 ? null : loopOf(k), at: 0, moved: false });
  seam.handle.classList.toggle("set", k >= 0 && data.edits.pinned[k]);
}

function sendSeam() {
  clearTimeout(seam.timer);
  if (!seam.moved || !seam.loop) return;
  seam.moved = false;
  tellSeam(false);
}

// draft: the ring may still move, and its place is only kept.
function tellSeam(draft) {
  const [x, y] = placeOn(seam.loop, seam.at);
  tell({ camgen: "seam", path: chosen.path, x: x + origin[0], y: y + origin[1], draft });
}

function setSeam() {
  const { handle } = seam;
  handle.type = "button";
  handle.hidden = true;
  handle.title = "Where the path begins: drag it along the path; arrow keys move it by 1 mm, with shift by 10, with alt by 0.1";
  handle.setAttribute("role", "slider");
  handle.setAttribute("aria-label", "Where the path begins");
  $("stage").append(handle);
  const area = () => canvas.getBoundingClientRect();
  handle.addEventListener("pointerdown", (event) => {
    handle.setPointerCapture(event.pointerId);
    $("tip").hidden = true;
  });
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    seam.at = nearestOn(seam.loop, event.clientX - area().left, event.clientY - area().top);
    seam.moved = true;
    redraw();
  });
  handle.addEventListener("pointerup", sendSeam);
  handle.addEventListener("blur", sendSeam);
  handle.addEventListener("keydown", (event) => {
    const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
    if (event.key === "Escape" && seam.moved) {
      Object.assign(seam, { at: 0, moved: false });
      tell({ camgen: "seam", path: chosen.path, draft: true });
    } else if (event.key === "Enter") sendSeam();
    else if (way) {
      seam.at += way * (event.shiftKey ? 10 : event.altKey ? 0.1 : 1);
      seam.moved = true;
      clearTimeout(seam.timer);
      seam.timer = setTimeout(sendSeam, 800);
      tellSeam(true);
    } else return;
    event.preventDefault();
    redraw();
  });
}

// Rows of the list.

function sendMove(from, to) {
  if (from >= 0 && to !== undefined && to !== from) tell({ camgen: "moved", path: from, to });
}

function setRows() {
  const rows = $("rows");
  const target = (event) => event.target.closest?.(".row");
  document.body.classList.add("edits");
  $("filter").title = "Drag rows to run paths in another order; Alt and arrow keys move the one that is chosen";
  $("list").setAttribute("aria-label", "Tool paths: arrow keys choose one, Alt and arrow keys move it");
  rows.addEventListener("dragstart", (event) => {
    event.dataTransfer.setData("text/x-path", target(event).dataset.path);
    event.dataTransfer.effectAllowed = "move";
  });
  for (const name of ["dragover", "dragleave", "drop"]) {
    rows.addEventListener(name, (event) => {
      if (!target(event) || !event.dataTransfer.types.includes("text/x-path")) return;
      event.preventDefault();
      for (const row of rows.querySelectorAll(".over")) row.classList.remove("over");
      if (name === "dragover") target(event).classList.add("over");
      if (name === "drop") sendMove(Number(event.dataTransfer.getData("text/x-path")), Number(target(event).dataset.path));
    });
  }
  $("list").addEventListener("keydown", (event) => {
    const way = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!way) return;
    event.preventDefault();
    const place = listed.indexOf(chosen.path) + (chosen.path < 0 && way < 0 ? listed.length + 1 : 0);
    const other = listed[place + way];
    if (event.altKey) sendMove(chosen.path, other);
    else if (other !== undefined) choose(other);
  });
}

// What has the keyboard keeps it in the page of the next program.
const focused = () => (document.activeElement === seam.handle ? "seam" : document.activeElement === $("list") ? "list" : "");
function focus(name) {
  if (name === "seam") paintSeam();
  if (name) window.focus();
  if (name === "seam" && !seam.handle.hidden) seam.handle.focus();
  if (name === "list") $("list").focus();
}

Object.assign(edits, {
  paint: paintSeam,
  choose: chooseSeam,
  row: (row, k) => {
    row.draggable = true;
    row.classList.toggle("ordered", data.edits.ordered[k]);
  },
  focused, focus,
});
setSeam();
setRows();
