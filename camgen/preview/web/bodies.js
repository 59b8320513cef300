// Bodies with faces, lit from the sky and by a lamp beside the viewer, and the simple ones among them.
const BODY_VERTEX = `
  layout(location = 0) in vec3 point;
  layout(location = 1) in vec3 normal;
  uniform mat4 clip, world;
  out vec3 vAt, vNormal;
  void main() {
    vAt = (world * vec4(point, 1.0)).xyz;
    vNormal = mat3(world) * normal;
    gl_Position = clip * vec4(point, 1.0);
  }`;
// Light adds up as it is, screens take its power 1 / 2.4, nearly: roots are quicker, and as near to it as a screen can show.
const LIT = program(BODY_VERTEX, `
  in vec3 vAt, vNormal;
  uniform vec3 colour, light;
  uniform float opacity, shine;
  out vec4 seen;
  void main() {
    vec3 normal = normalize(shine > 1.5 ? cross(dFdx(vAt), dFdy(vAt)) : gl_FrontFacing ? vNormal : -vNormal);
    vec3 sky = 2.3 * mix(vec3(0.366, 0.418, 0.491), vec3(1.0), 0.5 * normal.y + 0.5);
    vec3 own = min(colour * (sky + 1.3 * max(dot(normal, light), 0.0)) / 3.14159265, 1.0);
    vec3 root = sqrt(own);
    seen = vec4(0.64594 * root + 0.70816 * sqrt(root) - 0.33525 * sqrt(sqrt(root)) - 0.01889 * own, opacity);
  }`);
const PLAIN = program(`
  layout(location = 0) in vec3 point;
  uniform mat4 clip;
  void main() { gl_Position = clip * vec4(point, 1.0); }`, `
  uniform vec3 colour;
  uniform float opacity;
  out vec4 seen;
  void main() { seen = vec4(colour, opacity); }`);

// shine: 0 as coloured, 1 smooth by its normals, 2 by its faces.
function solid(shape_, { name = "", shine = 1, opacity = 1, order = 0, ...rest } = {}) {
  const uniforms = { ...shared, colour: { value: [0, 0, 0] }, opacity: { value: opacity }, shine: { value: shine } };
  return thing({ name, order, draw: drawing(shape_, shine ? LIT : PLAIN, uniforms, { clear: opacity < 1, ...rest }) });
}

// A colour as light.
const asLight = (colour) => colour.map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
function paintSolid({ program: own, uniforms }, colour) {
  uniforms.colour.value = own === LIT ? asLight(colour) : colour;
}

const PUSHED = { offset: [1, 1] };

// A cuboid of these half edges, about its middle.
function boxShape(half) {
  const [points, normals, index] = [[], [], []];
  for (let k = 0; k < 6; k++) {
    const side = k < 3 ? 1 : -1;
    const [u, v] = [(k + 1) % 3, (k + 2) % 3];
    for (const [p, q] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
      const corner = [0, 0, 0];
      [corner[k % 3], corner[u], corner[v]] = [side * half[k % 3], side * p * half[u], q * half[v]];
      points.push(...corner);
      normals.push(...scaled(axisOf(k % 3), side));
    }
    index.push(...[0, 1, 2, 0, 2, 3].map((corner) => 4 * k + corner));
  }
  return shape({ points: new Float32Array(points), normals: new Float32Array(normals), index: new Uint32Array(index) });
}

function boxEdges(half) {
  const points = [];
  for (let k = 0; k < 3; k++) {
    for (const [p, q] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
      for (const side of [-1, 1]) {
        const corner = [0, 0, 0];
        [corner[k], corner[(k + 1) % 3], corner[(k + 2) % 3]] = [side * half[k], p * half[(k + 1) % 3], q * half[(k + 2) % 3]];
        points.push(...corner);
      }
    }
  }
  return shape({ points: new Float32Array(points), lines: true });
}

// An outline (radius, height) turned about z, from its lowest point to its highest; its normals are those of its own
// faces. What has a radius at an end is closed there by a point on the axis.
function turnedShape(outline, turns) {
  const [points, normals, index] = [[], [], []];
  for (let i = 1; i < outline.length; i++) {
    const [[r, z], [r1, z1]] = [outline[i - 1], outline[i]];
    const long = Math.hypot(r1 - r, z1 - z) || 1;
    const first = points.length / 3;
    for (let k = 0; k <= turns; k++) {
      const [c, s] = [Math.cos((2 * Math.PI * k) / turns), Math.sin((2 * Math.PI * k) / turns)];
      points.push(r * c, r * s, z, r1 * c, r1 * s, z1);
      const normal = [(c * (z1 - z)) / long, (s * (z1 - z)) / long, (r - r1) / long];
      normals.push(...normal, ...normal);
      const at = first + 2 * k;
      if (k < turns) index.push(at, at + 2, at + 1, at + 1, at + 2, at + 3);
    }
  }
  return shape({ points: new Float32Array(points), normals: new Float32Array(normals), index: new Uint32Array(index) });
}

// A cylinder, or a part of a cone, from a to b.
function rod(a, b, radiusA, radiusB, name, rest = PUSHED, turns = 40) {
  const way = minus(b, a);
  const outline = [[0, 0], [radiusA, 0], [radiusB, sizeOf(way)], [0, sizeOf(way)]];
  const made = solid(turnedShape(outline, turns), { name, oneSided: true, ...rest });
  made.matrix = product(moveBy(a), turnTo3([0, 0, 1], unit(way)));
  return made;
}
