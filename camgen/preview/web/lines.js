// Lines of a width in pixels and marks of a size in pixels: one draw call each, whatever their number. What is drawn
// lies in textures, from which the vertices fetch it: instances of four vertices are slow where no graphics card helps.
const shared = {
  size: { value: [1, 1] },
  pixel: { value: 1 },
  thinnest: { value: 0 },
  perMm: { value: 1 },
  low: { value: [0, 0, 0] },
  middle: { value: [0, 0, 0] },
  high: { value: [0, 0, 0] },
  light: { value: [0, 0, 1] },
  lift: { value: 0 },
  deep: { value: 0 },
  pickColour: { value: [0, 0, 0] },
  now: { value: -1 },
};

const COLOURED = `
  uniform vec3 low, middle, high, colour, pickColour;
  in float vValue, vPicked;
  out vec4 seen;
  vec3 painted() {
    vec3 own = vValue < 0.0 ? colour : vValue < 0.5 ? mix(low, middle, vValue * 2.0) : mix(middle, high, vValue * 2.0 - 1.0);
    return vPicked > 0.5 ? pickColour : own;
  }`;

// group: what a segment belongs to, -1 for free travel, -0.75 for travel in lines; below -1.5 nothing is drawn.
const LINE_VERTEX = `
  uniform highp sampler2D stations, infos, rows;
  uniform int picked;
  uniform vec2 size;
  uniform float width, pixel, thinnest, perMm, pick, now, work, travel, approach, picks, lift, order;
  uniform mat4 clip;
  out float vValue, vPicked, vPale, vRun, vDash;
  int rowOf(int k) {
    int texel = k >> 2;
    return picked == 0 ? k : int(texelFetch(rows, ivec2(texel & 2047, texel >> 11), 0)[k & 3]);
  }
  void main() {
    int row = rowOf(gl_VertexID >> 2);
    int corner = gl_VertexID & 3;
    vec3 a = texelFetch(stations, ivec2(row & 2047, row >> 11), 0).xyz;
    float begun = texelFetch(stations, ivec2((row + 1) & 2047, (row + 1) >> 11), 0).w;
    row = rowOf((gl_VertexID >> 2) + 1);
    ivec2 spot = ivec2(row & 2047, row >> 11);
    vec4 end = texelFetch(stations, spot, 0);
    vec4 info = texelFetch(infos, spot, 0);
    vec3 b = end.xyz;
    float group = end.w, value = info.x, time = info.y, run = info.z;
    vec2 place = vec2(corner > 1 ? 1.0 : 0.0, corner == 1 || corner == 2 ? 1.0 : -1.0);
    bool moving = group < -0.5, free = group < -0.9;
    vec4 p = clip * vec4(a, 1.0);
    vec4 q = clip * vec4(b, 1.0);
    vec2 way = (q.xy - p.xy) * size * 0.5;
    float wide = length(way);
    way = wide > 1e-4 ? way / wide : vec2(1.0, 0.0);
    vPicked = picks > 0.5 && !moving && abs(group - pick) < 0.5 ? 1.0 : 0.0;
    float half_ = 0.5 * max(pixel * (moving ? 1.1 : vPicked > 0.5 ? width + 2.0 : width), thinnest);
    vec4 at = place.x < 0.5 ? p : q;
    float cap = moving ? 0.0 : place.x * 2.0 - 1.0;
    at.xy += (vec2(-way.y, way.x) * place.y + way * cap * 0.7) * half_ * 2.0 / size;
    at.z -= lift * (vPicked > 0.5 ? 4.0 : order);
    vValue = moving ? -1.0 : value;
    vPale = now >= 0.0 && time > now ? 0.62 : 0.0;
    vRun = (run - (1.0 - place.x) * distance(a, b)) * perMm;
    vDash = free ? 1.0 : moving ? 2.0 : 0.0;
    gl_Position = group < -1.5 || begun != group || (free ? travel : moving ? approach : work) < 0.5 ? vec4(2.0, 2.0, 2.0, 1.0) : at;
  }`;
const LINE_FRAGMENT = `${COLOURED}
  in float vPale, vRun, vDash;
  uniform vec3 other, near, back;
  uniform float opacity;
  void main() {
    if (vDash > 0.5 && vDash < 1.5 && mod(vRun, 9.0) > 5.5) discard;
    seen = vec4(mix(vDash > 1.5 ? near : vDash > 0.5 ? other : painted(), back, vPale), opacity);
  }`;

const LINES = program(LINE_VERTEX, LINE_FRAGMENT);

// Four vertices for each of `count` quads: the same index serves all, each takes as much of it as it needs.
const quads = { count: 0, index: null };
function quadIndex(count) {
  if (count > quads.count) Object.assign(quads, { count, index: null });
  return () => (quads.index ??= indexBuffer(quadCorners(quads.count)))();
}

function quadCorners(count) {
  const index = new Uint32Array(6 * count);
  for (let k = 0, at = 0, corner = 0; k < count; k++, corner += 4) {
    index[at++] = corner;
    index[at++] = corner + 2;
    index[at++] = corner + 1;
    index[at++] = corner;
    index[at++] = corner + 3;
    index[at++] = corner + 2;
  }
  return index;
}

const quadShape = (count) => shape({ indexes: quadIndex(count), count: 6 * count });
const WIDE = 2048;

// Four columns as the texels of a texture: three that stand together (three numbers for each) and a fourth, or four.
function texels(count, fill) {
  const high = Math.max(Math.ceil(count / WIDE), 1);
  const values = new Float32Array(4 * WIDE * high);
  for (let k = 0; k < count; k++) fill(values, 4 * k, k);
  return table(values, WIDE, high);
}
const besides = (three, fourth) => (values, at, k) => {
  values[at] = three[3 * k];
  values[at + 1] = three[3 * k + 1];
  values[at + 2] = three[3 * k + 2];
  values[at + 3] = fourth ? fourth[k] : 0;
};

// A chain of points (Float32Array, three for each): what is said of segment i stands at its end, index i + 1. key: rows of
// which it differs are not drawn as one.
function lines({ points, group, key, time, run, width, picks = 0, order = 1, opacity = 1 }) {
  const count = points.length / 3;
  const segments = Math.max(count - 1, 0);
  const infos = texels(count, (values, at, k) => {
    values[at] = -1;
    if (time) values[at + 1] = time[k];
    if (run) values[at + 2] = run[k];
  });
  const draw = drawing(quadShape(segments), LINES, {
    ...shared, picked: { value: 0 }, rows: { value: null }, stations: { value: texels(count, besides(points, group)) }, infos: { value: infos },
    colour: { value: [0, 0, 0] }, other: { value: [0, 0, 0] }, near: { value: [0, 0, 0] }, back: { value: [0, 0, 0] },
    width: { value: width },
    work: { value: 1 }, travel: { value: 1 }, approach: { value: 1 }, picks: { value: picks }, pick: { value: -9 },
    opacity: { value: opacity }, order: { value: order },
  }, { clear: true });
  chains.push(levelsOf({ points, group, key, draw }));
  return thing({ draw });
}

// Of each chain what chooses its detail.
const chains = [];

// room: mm on the path that belong to the mark; it is left out where that is too little on the screen.
const MARK_VERTEX = `
  uniform highp sampler2D places, ways;
  uniform vec2 size;
  uniform float pixel, perMm, least, radius, lift, deep;
  uniform mat4 clip;
  out vec2 vCorner;
  void main() {
    int row = gl_VertexID >> 2;
    int corner = gl_VertexID & 3;
    ivec2 spot = ivec2(row & 2047, row >> 11);
    vec4 place = texelFetch(places, spot, 0);
    vec3 at = place.xyz, way = texelFetch(ways, spot, 0).xyz;
    float room = place.w;
    vec2 own = vec2(corner > 1 ? 1.0 : -1.0, corner == 1 || corner == 2 ? 1.0 : -1.0);
    vec4 p = clip * vec4(at, 1.0);
    vec4 q = clip * vec4(at + way, 1.0);
    vec2 towards = (q.xy - p.xy) * size;
    float run = length(towards);
    bool seen = room * perMm >= least && (dot(way, way) < 1e-9 || run > 0.3 * perMm);
    towards = run > 1e-9 ? towards / run : vec2(1.0, 0.0);
    vCorner = own;
    p.xy += (towards * own.x + vec2(-towards.y, towards.x) * own.y) * radius * pixel * 2.0 / size;
    p.z -= lift * 5.0 + deep * radius / perMm;
    gl_Position = seen ? p : vec4(2.0, 2.0, 2.0, 1.0);
  }`;
const MARK_FRAGMENT = `
  in vec2 vCorner;
  out vec4 seen;
  uniform vec3 colour, back;
  uniform float arrow;
  void main() {
    if (arrow > 0.5 && (abs(vCorner.y) > 0.5 - 0.5 * vCorner.x || vCorner.x < -0.9 + 0.5 * (1.0 - abs(vCorner.y)))) discard;
    float r = length(vCorner);
    if (arrow < 0.5 && r > 1.0) discard;
    seen = vec4(arrow < 0.5 && r < 0.55 ? back : colour, 1.0);
  }`;

const MARKS = program(MARK_VERTEX, MARK_FRAGMENT);

function marks(at, way, room, { radius, least, arrow }) {
  const draw = drawing(quadShape(room.length), MARKS, {
    ...shared, places: { value: texels(room.length, besides(at, room)) }, ways: { value: texels(room.length, besides(way)) },
    colour: { value: [0, 0, 0] }, back: { value: [0, 0, 0] }, radius: { value: radius }, least: { value: least },
    arrow: { value: arrow ? 1 : 0 },
  }, { clear: true });
  return thing({ draw });
}
