// The list of paths: only the rows that are seen are in the page, however many paths there are.
const forced = data.paths.some((path) => path.force > 0);
const several = data.paths.some((path) => path.operation);
// Pictures have no layers.
const layered = data.paths.some((path) => path.layer);
document.body.classList.toggle("several", several);
document.body.style.setProperty("--columns", [
  "42px", "minmax(0, 1fr)", ...(several ? ["minmax(0, 2fr)"] : []), ...(layered ? [`minmax(0, ${several ? 1 : 1.3}fr)`] : []),
  forced || several ? "56px 42px" : "62px 48px", ...(forced ? ["36px"] : []),
].join(" "));
const rowHeight = () => (innerWidth <= 760 ? 36 : 30);
let listed = data.paths.map((_, k) => k);
const chosen = { path: -1, now: -1 };

function cells(row, texts) {
  texts.forEach((text, k) => {
    const cell = make("span", text, k > (several ? 1 : 0) + (layered ? 2 : 1) ? "n" : "");
    if (k) cell.title = text;
    row.append(cell);
  });
}

function rowOf(k) {
  const path = data.paths[k];
  const row = make("div", "", "row");
  const passes = path.passes > 1 ? ` x${path.passes}` : "";
  cells(row, ["", path.id + passes, ...(several ? [path.operation] : []), ...(layered ? [path.layer] : []), number(path.length), number(path.feed), ...(forced ? [number(path.force)] : [])]);
  const dot = make("i");
  dot.style.background = rgb(rampColour(SCALES.order.high ? k / SCALES.order.high : 0));
  row.firstChild.className = "k";
  row.firstChild.append(dot, String(k + 1));
  row.dataset.path = k;
  edits.row?.(row, k);
  return row;
}

// The rows that are seen, by path. A row stays the same element while it is seen: a double click needs both clicks on it.
const seenRows = new Map();

function fillList() {
  const list = $("list");
  const height = rowHeight();
  const first = Math.max(Math.floor(list.scrollTop / height) - 4, 0);
  const wanted = listed.slice(first, first + Math.ceil(list.clientHeight / height) + 8);
  $("rows").style.height = `${listed.length * height}px`;
  const kept = new Set(wanted);
  for (const [k, row] of seenRows) {
    if (kept.has(k)) continue;
    row.remove();
    seenRows.delete(k);
  }
  wanted.forEach((k, i) => {
    if (!seenRows.has(k)) {
      seenRows.set(k, rowOf(k));
      $("rows").append(seenRows.get(k));
    }
    const row = seenRows.get(k);
    row.style.top = `${(first + i) * height}px`;
    row.classList.toggle("picked", k === chosen.path);
    row.classList.toggle("now", k === chosen.now);
  });
}

// All rows anew, in other colours.
function refillList() {
  for (const row of seenRows.values()) row.remove();
  seenRows.clear();
  fillList();
}

function scrollTo(k) {
  const list = $("list");
  const top = listed.indexOf(k) * rowHeight();
  if (top >= 0 && (top < list.scrollTop || top + rowHeight() > list.scrollTop + list.clientHeight)) {
    list.scrollTop = Math.max(top - list.clientHeight / 3, 0);
  }
}

// A path named in the list or hit in the picture; -1 for none.
function choose(k, scroll = true) {
  if (k !== chosen.path) edits.choose?.(k);
  chosen.path = k;
  way.draw.uniforms.pick.value = k < 0 ? -9 : k;
  if (scroll && k >= 0) scrollTo(k);
  fillList();
  redraw();
}

function running(k) {
  if (k === chosen.now) return;
  chosen.now = k;
  if (k >= 0 && player.on) scrollTo(k);
  fillList();
}

function setList() {
  addTab("paths", `Paths ${data.paths.length}`);
  whenShown("paths", fillList);
  cells($("head"), ["#", "Path", ...(several ? ["Operation"] : []), ...(layered ? ["Layer"] : []), "Length\nmm", "Feed\nmm/s", ...(forced ? ["Force\nN"] : [])]);
  $("list").addEventListener("scroll", fillList);
  $("rows").addEventListener("click", (event) => {
    const row = event.target.closest(".row");
    // The second click of two is not one to let go of the path.
    if (!row || event.detail > 1) return;
    choose(Number(row.dataset.path) === chosen.path ? -1 : Number(row.dataset.path), false);
    tellPicked({ path: chosen.path, line: -1, place: null });
  });
  $("rows").addEventListener("dblclick", (event) => {
    const row = event.target.closest(".row");
    if (row) toPath(Number(row.dataset.path));
  });
  $("filter").addEventListener("input", (event) => {
    const text = event.target.value.toLowerCase();
    const has = (path) => path.id.toLowerCase().includes(text) || path.layer.toLowerCase().includes(text) || path.operation.toLowerCase().includes(text);
    listed = data.paths.flatMap((path, k) => (has(path) ? [k] : []));
    fillList();
  });
}

// To the moment where the work on a path begins.
function toPath(k) {
  const s = worked.find((station) => track.path[track.event[station]] === k);
  if (s !== undefined) player.to(track.time[s - 1]);
  choose(k);
}
