// The cut: what the tools of the program leave of the stock, as heights over a grid, and what a proof found of it.
//
// The height at a sample is the least that a tool has reached above it. At a wall it passes from the floor to the top
// within the width of a cell, half of it on either side, so that the wall stands where the tool ran, between samples too.
const CUT = {
  most: 160000, // samples
  across: 6, // cells across the smallest tool, where `most` allows it
  perCell: 1.5, // pixels of the canvas: finer ones are not seen
  snapshots: 48,
  apart: 3e5, // samples that are looked at from one snapshot to the next, at least
  slack: 0.02, // mm that a rapid may be below the surface by what curves and the grid leave
  budget: isDrawnByProcessor ? 120 : 12, // ms of a frame, more where drawing it takes as long
  coarsest: 4, // every so many samples are drawn where all of them take too long
};

function makeField({ low, high }, cell) {
  const [nx, ny] = [0, 1].map((k) => Math.max(Math.ceil((high[k] - low[k]) / cell - 1e-6), 1) + 1);
  const count = nx * ny;
  return {
    low, high, cell, nx, ny, heights: new Float32Array(count).fill(high[2]), struck: new Uint8Array(count),
    dirty: [0, ny - 1],
  };
}

// The outline of a tool as a table over the radius: how high it is above its tip, and which share of the way up to the
// top the wall has there. flat: radius within which it is as low as its tip.
function makeShape({ profile, diameter }, cell) {
  const radius = diameter / 2;
  const core = Math.max(radius - cell / 2, 0);
  const reach = radius + cell / 2;
  const size = 512;
  const shape = { radius, reach, per: size / reach, rise: new Float32Array(size + 2), wall: new Float32Array(size + 2) };
  const rise = (r) => {
    const k = profile.findIndex(([at]) => at >= r);
    if (k < 0) return profile.at(-1)[1];
    const [[r0, z0], [r1, z1]] = [profile[Math.max(k - 1, 0)], profile[k]];
    return r1 > r0 ? z0 + ((z1 - z0) * (r - r0)) / (r1 - r0) : z1;
  };
  for (let k = 0; k < size + 2; k++) {
    const r = (k / size) * reach;
    shape.rise[k] = rise(Math.min(r, radius));
    shape.wall[k] = Math.min(Math.max((r - core) / (reach - core), 0), 1);
  }
  shape.flat = Math.min(Math.max(...profile.filter(([, z]) => z < 1e-9).map(([r]) => r)), core);
  return shape;
}

// Lowers what the tool sweeps from a to b. A way that goes down as it goes along is looked at where it comes nearest to
// a sample and, for a flat tip, where that passes the sample at its lowest. Gives whether a rapid met material.
function carve(field, shape, a, b, rapid) {
  const { low, cell, nx, ny, heights, struck } = field;
  const { reach, per, rise, wall, flat } = shape;
  const top = field.high[2];
  const bottom = low[2];
  if (Math.min(a[2], b[2]) >= top) return false;
  const [dx, dy, dz] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
  const length = Math.hypot(dx, dy);
  const square = length * length;
  const level = Math.abs(dz) < 1e-9 || length < 1e-9;
  const still = dz < 0 ? 1 : 0;
  // A rapid is looked at within what the tool clears for certain: not in the wall that it cut itself.
  const core = Math.min(0.9 * shape.radius, shape.radius - cell / 2);
  const sample = (value, k) => (value - low[k]) / cell;
  const first = Math.max(Math.ceil(sample(Math.min(a[1], b[1]) - reach, 1)), 0);
  const last = Math.min(Math.floor(sample(Math.max(a[1], b[1]) + reach, 1)), ny - 1);
  let met = false;
  for (let j = first; j <= last; j++) {
    const y = low[1] + j * cell - a[1];
    let [from, to] = [Math.min(0, dx) - reach, Math.max(0, dx) + reach];
    if (Math.abs(dy) > 1e-3 * length) {
      // The strip of the sweep in this row.
      const [middle, half] = [(y * dx) / dy, (reach * length) / Math.abs(dy)];
      [from, to] = [Math.max(from, middle - half), Math.min(to, middle + half)];
    }
    const end = Math.min(Math.floor(sample(to + a[0], 0)), nx - 1);
    for (let i = Math.max(Math.ceil(sample(from + a[0], 0)), 0); i <= end; i++) {
      const x = low[0] + i * cell - a[0];
      let t = square > 0 ? Math.min(Math.max((x * dx + y * dy) / square, 0), 1) : still;
      const gap = Math.hypot(x - t * dx, y - t * dy);
      if (gap > reach) continue;
      const place = gap * per;
      const row = Math.floor(place);
      const share = place - row;
      let z = a[2] + t * dz + rise[row] + (rise[row + 1] - rise[row]) * share;
      if (!level && gap < flat) {
        const beside = (x * dy - y * dx) / length;
        const along = (x * dx + y * dy) / length;
        const run = Math.sqrt(Math.max(flat * flat - beside * beside, 0));
        t = Math.min(Math.max((along + (dz < 0 ? run : -run)) / length, 0), 1);
        z = Math.min(z, a[2] + t * dz);
      }
      const k = j * nx + i;
      if (z >= top) continue;
      if (rapid && gap <= core && Math.max(z, bottom) < heights[k] - CUT.slack) {
        struck[k] = 1;
        met = true;
      }
      z += (wall[row] + (wall[row + 1] - wall[row]) * share) * (top - z);
      if (z < heights[k]) heights[k] = Math.max(z, bottom);
    }
  }
  field.dirty[0] = Math.min(field.dirty[0], first);
  field.dirty[1] = Math.max(field.dirty[1], last);
  return met;
}

// The stations at which the sweep is taken up, without those that are nearer to the one before than half a cell.
function thin(cell, rapid, tool) {
  const ends = [0];
  const { position } = track;
  for (let s = 1; s < stations; s++) {
    const p = ends.at(-1);
    const [x, y, z] = [0, 1, 2].map((k) => Math.abs(position[3 * s + k] - position[3 * p + k]));
    const other = s + 1 < stations && (rapid(s + 1) !== rapid(s) || tool(s + 1) !== tool(s));
    if (x + y > cell / 2 || z > 0.01 || other || s === stations - 1) ends.push(s);
  }
  return Uint32Array.from(ends);
}

function makeStock() {
  const { low, high } = data.stock;
  const [wide, deep] = [0, 1].map((k) => high[k] - low[k]);
  const shapes = data.tools.filter(({ profile }) => profile.length);
  const smallest = Math.min(...shapes.map(({ diameter }) => diameter));
  const seen = CUT.perCell * Math.max(wide / Math.max(canvas.clientWidth, 300), deep / Math.max(canvas.clientHeight, 300));
  const cell = Math.max(Math.min(seen, smallest / CUT.across), Math.sqrt((wide * deep) / CUT.most), Math.max(wide, deep) / 2000);
  const field = makeField({ low, high }, cell);
  const tables = data.tools.map((tool) => (tool.profile.length ? makeShape(tool, cell) : null));
  const tool = (s) => toolOf[track.event[s]];
  const rapid = (s) => track.kind[track.event[s]] === 0;
  const ends = thin(cell, rapid, tool);
  const at = (s) => track.position.subarray(3 * s, 3 * s + 3);
  const cut = (step, target) => {
    const s = ends[step];
    const shape = tables[tool(s)];
    if (shape && carve(field, shape, at(ends[step - 1]), target, rapid(s))) stock.met.add(track.event[s]);
  };

  // Snapshots after steps, the first before all of them. done: steps in the field; time: to which a part of the next
  // one is in it.
  const kept = [{ done: 0, heights: field.heights.slice(), struck: field.struck.slice() }];
  const work = new Float64Array(ends.length);
  for (let step = 1; step < ends.length; step++) {
    const [a, b] = [at(ends[step - 1]), at(ends[step])];
    const across = (2 * (tables[tool(ends[step])]?.reach ?? 0)) / cell;
    work[step] = work[step - 1] + across * (across + Math.hypot(b[0] - a[0], b[1] - a[1]) / cell);
  }
  const apart = Math.max(CUT.apart, work.at(-1) / CUT.snapshots);

  function restore(snapshot) {
    field.heights.set(snapshot.heights);
    field.struck.set(snapshot.struck);
    field.dirty = [0, field.ny - 1];
    stock.done = snapshot.done;
    stock.time = stock.reached = track.time[ends[snapshot.done]];
  }
  function keep() {
    const last = kept.at(-1).done;
    if (stock.done > last && work[stock.done] - work[last] >= apart) {
      kept.push({ done: stock.done, heights: field.heights.slice(), struck: field.struck.slice() });
    }
  }

  const stock = {
    field, kept, met: new Set(), done: 0, time: 0, wanted: 0, reached: 0,
    // What is to be seen is the state at `time`; `work` gets there in one or several frames, and has `reached` a time,
    // which several steps may have in common: `time` is -1 while not all of them are done.
    to(time) { this.wanted = time; },
    // Carves for so many ms; true where there is something new to be drawn.
    work(budget = CUT.budget) {
      const { wanted } = this;
      if (wanted === this.time) return false;
      const most = kept.findLast(({ done }) => track.time[ends[done]] <= wanted);
      if (wanted < this.reached || most.done > this.done) restore(most);
      const begun = performance.now();
      const last = ends.length - 1;
      for (let looked = work[this.done]; this.done < last && track.time[ends[this.done + 1]] <= wanted;) {
        this.done++;
        cut(this.done, at(ends[this.done]));
        keep();
        if (work[this.done] - looked < 20000) continue;
        looked = work[this.done];
        if (performance.now() - begun > budget) {
          this.reached = track.time[ends[this.done]];
          this.time = this.reached === wanted ? -1 : this.reached;
          return true;
        }
      }
      if (this.done < last) cut(this.done + 1, placeAt(wanted).at);
      this.time = this.reached = wanted;
      return true;
    },
  };
  return stock;
}

// The grid as triangles between its samples, or between every second, fourth ... of them; around them one more row and column that goes down to the bottom.
const STOCK_VERTEX = `
  uniform highp sampler2D field;
  uniform int nx, ny, stride;
  uniform vec3 corner, far;
  uniform float cell, flatten;
  uniform mat4 clip;
  out vec3 vAt;
  out float vStruck, vBorder;
  void main() {
    ivec2 last = (ivec2(nx, ny) - 2 + stride) / stride;
    ivec2 at = ivec2(gl_VertexID % (last.x + 3), gl_VertexID / (last.x + 3)) - 1;
    bool border = any(lessThan(at, ivec2(0))) || any(greaterThan(at, last));
    ivec2 spot = clamp(at * stride, ivec2(0), ivec2(nx, ny) - 1);
    vec4 here = texelFetch(field, spot, 0);
    vAt = vec3(min(corner.xy + vec2(spot) * cell, far.xy), border ? corner.z : here.x);
    vStruck = here.y;
    vBorder = border ? 1.0 : 0.0;
    vec3 shown = vec3(vAt.xy, flatten > 0.5 ? corner.z : vAt.z);
    gl_Position = clip * vec4(shown, 1.0);
  }`;
const STOCK_FRAGMENT = `
  uniform vec3 corner, far, light, colour, floorColour, deepColour, struckColour;
  uniform float flatten;
  in vec3 vAt;
  in float vStruck, vBorder;
  out vec4 seen;
  void main() {
    float thick = far.z - corner.z;
    vec3 normal = normalize(cross(dFdx(vAt), dFdy(vAt)));
    if (normal.z < 0.0) normal = -normal;
    // Cut through: nothing is left there.
    if (vAt.z < corner.z + 2e-3 * thick && (normal.z > 0.5 || flatten > 0.5) && vBorder < 0.01) discard;
    float depth = (far.z - vAt.z) / thick;
    vec3 base = depth < 1e-3 ? colour : mix(floorColour, deepColour, depth);
    if (flatten > 0.5) { base = colour; normal = vec3(0.0, 0.0, -1.0); }
    if (normal.z < 0.7 && depth > 0.0 && vBorder == 0.0) base = deepColour;
    if (vBorder > 0.0) base = colour;
    if (vStruck > 0.5) base = struckColour;
    seen = vec4(base * (0.52 + 0.5 * max(dot(normal, light), 0.0)), 1.0);
  }`;

const STOCKS = program(STOCK_VERTEX, STOCK_FRAGMENT);

function grid(nx, ny, stride) {
  const [wide, high] = [nx, ny].map((n) => Math.floor((n - 2 + stride) / stride) + 3);
  const index = new Uint32Array(6 * (wide - 1) * (high - 1));
  let at = 0;
  for (let j = 0; j < high - 1; j++) {
    for (let k = j * wide; k < (j + 1) * wide - 1; k++) {
      index[at++] = k;
      index[at++] = k + 1;
      index[at++] = k + wide + 1;
      index[at++] = k;
      index[at++] = k + wide + 1;
      index[at++] = k + wide;
    }
  }
  return shape({ index });
}

function drawStock({ field }) {
  const { nx, ny, cell, low, high } = field;
  const values = new Float32Array(4 * nx * ny);
  const texture = table(values, nx, ny);
  const strideAt = { value: 1 };
  const colours = Object.fromEntries(["colour", "floorColour", "deepColour", "struckColour"].map((name) => [name, { value: [0, 0, 0] }]));
  const shapes = {};
  const made = [0, 1].map((flatten) => {
    const uniforms = {
      ...shared, field: { value: texture }, nx: { value: nx }, ny: { value: ny }, cell: { value: cell }, flatten: { value: flatten },
      corner: { value: low }, far: { value: high }, ...colours, stride: strideAt,
    };
    return put("stock", thing({ name: "stock", draw: drawing(null, STOCKS, uniforms, { offset: [2, 2] }) }), 0);
  });
  return {
    theme() {
      const names = { colour: "stock", floorColour: "cut", deepColour: "cut-deep", struckColour: "bad" };
      for (const [name, style] of Object.entries(names)) colours[name].value = colourOf(css(style));
    },
    told: false,
    // Before a frame: new heights to the graphics card, as many triangles as the pace allows, the bottom where it is seen.
    paint() {
      const [from, to] = field.dirty;
      if (to >= from) {
        for (let k = from * nx; k < (to + 1) * nx; k++) {
          values[4 * k] = field.heights[k];
          values[4 * k + 1] = field.struck[k];
        }
        field.dirty = [ny, -1];
        texture.changed = [Math.min(from, texture.changed?.[0] ?? from), Math.max(to, texture.changed?.[1] ?? to)];
      }
      strideAt.value = Math.min(strideOf(pace.drawn), CUT.coarsest);
      const shape_ = shapes[strideAt.value] ??= grid(nx, ny, strideAt.value);
      for (const one of made) one.draw.shape = shape_;
      if (cutting.stock.met.size && !this.told && $("hint").hidden) {
        this.told = true;
        $("hint").hidden = false;
        $("hint").textContent = "Red: a rapid through material";
      }
      made[1].visible = !layers.stock.off && look.tilt < 0;
    },
  };
}

// Gouges and what is left: outlines that are seen from afar, over their fill.
function drawMarks() {
  for (const kind of ["gouge", "excess"]) {
    const own = (data.marks ?? []).filter((mark) => mark.kind === kind);
    if (!own.length) continue;
    const outlines = own.map(({ outline }) => unpack(outline));
    const points = new Float32Array(outlines.reduce((sum, one) => sum + one.length, 0));
    const group = new Float32Array(points.length / 3);
    let at = 0;
    for (const one of outlines) {
      points.set(one, at);
      group[at / 3] = -2;
      at += one.length;
    }
    const around_ = lines({ points, group, width: 3 });
    around_.draw.depthTest = false;
    put(kind, around_, 8);
    for (const { triangles } of own) {
      const fill = shape({ points: unpack(triangles) });
      put(kind, solid(fill, { name: kind, shine: 0, opacity: 0.55, depthTest: false, depthWrite: false }), 7);
    }
  }
}

// The tools in the place of the one rod, each as its outline says; the page shows the one that works.
function drawTools() {
  if (!data.tools || !toolGroup.parts.some(({ name }) => name === "tool")) return;
  toolGroup.parts = toolGroup.parts.filter(({ name }) => name !== "tool");
  const meshes = data.tools.map(({ profile, diameter }) => {
    const outline = profile.length ? profile : [[0, 0], [diameter / 2, 0]];
    const top = Math.max(extent * 0.3, 2 * diameter);
    // From the shank, which is closed, down to the tip: the tool points down along z.
    const whole = [...outline, [diameter / 2, top], [0, top]].reverse().map(([radius, height]) => [radius, -height]);
    const one = solid(turnedShape(whole, 64), { name: "tool", shine: 2, opacity: 0.4 });
    toolGroup.parts.push(one);
    return one;
  });
  cutting.tool = (chosen_) => meshes.forEach((one, k) => { one.visible = k === chosen_; });
  cutting.tool(toolOf[0]);
}

Object.assign(cutting, { makeField, makeShape, carve });
drawMarks();
drawTools();
if (data.stock) {
  cutting.stock = makeStock();
  cutting.shown = drawStock(cutting.stock);
}
