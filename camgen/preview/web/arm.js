// The robot, link by link, and the tool that moves along the program.
function matrixOf(pose) {
  const [a, b, c, d, e, f, g, h, i, x, y, z] = pose;
  return new THREE.Matrix4().set(a, b, c, x, d, e, f, y, g, h, i, z, 0, 0, 0, 1);
}

const arm = data.arm && {
  ...data.arm, values: unpack(data.arm.values), time: unpack(data.arm.time), links3: [],
  base: new THREE.Matrix4().makeTranslation(...origin.map((v) => -v)).multiply(matrixOf(data.arm.work_from_base)),
  flangeFrom: matrixOf(data.arm.flange), previous: data.arm.joints.map((joint) => matrixOf(joint[2])),
  size: data.arm.joints.reduce((sum, joint) => sum + Math.hypot(...joint[2].slice(9)), 0),
};
const flangeFromTool = matrixOf(data.tool.flange_from_tool);
// Of each tool where there are several.
const toolFrames = data.tools?.map((tool) => matrixOf(tool.flange_from_tool)) ?? [flangeFromTool];
const frameAt = (event) => toolFrames[toolOf ? toolOf[event] : 0];

function cuboid([pose, half], name = "arm") {
  const group = new THREE.Group();
  const shape = new THREE.BoxGeometry(...half.map((v) => 2 * v));
  const body_ = new THREE.Mesh(shape, new THREE.MeshLambertMaterial({ polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
  const edges = new THREE.LineSegments(new THREE.EdgesGeometry(shape), new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55 }));
  [body_.name, edges.name] = [name === "arm" ? "boxes" : name, name === "arm" ? "boxes-edge" : "part"];
  if (name === "arm") Object.assign(body_.material, { transparent: true, opacity: 0.35, depthWrite: false, polygonOffsetFactor: -1, polygonOffsetUnits: -4 });
  group.add(body_, edges);
  matrixOf(pose).decompose(group.position, group.quaternion, group.scale);
  return group;
}

// A thing of a layer that moves with another one.
function hang(layer, parent, things) {
  const group = new THREE.Group();
  if (things.length) group.add(...things);
  parent.add(group);
  layers[layer].things.push(group);
}

// Cuboids of one frame told in another: from_ is where the first stands in the second.
const toldFrom = (from_, boxes) => boxes.map(([pose, half]) => {
  const m = new THREE.Matrix4().multiplyMatrices(from_, matrixOf(pose)).elements;
  return [[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10], m[12], m[13], m[14]], half];
});

function setArm() {
  const origin_ = new THREE.Vector3();
  arm.links.forEach(([, boxes, mesh], k) => {
    const link = new THREE.Group();
    link.matrixAutoUpdate = false;
    scene.add(link);
    arm.links3.push(link);
    const [own, next] = [arm.joints[k - 1], arm.joints[k]];
    const entry = own && { at: origin_.clone(), axis: new THREE.Vector3(...own[3]).normalize(), sliding: own[1] };
    const exit = next && { at: origin_.clone().applyMatrix4(arm.previous[k]), sliding: next[1] };
    const before = k ? toldFrom(arm.previous[k - 1].clone().invert(), arm.links[k - 1][1]) : [];
    hang("robot", link, mesh ? [linkMesh(mesh)] : linkShapes(boxes, entry, exit, before));
    hang("boxes", link, boxes.map((one) => cuboid(one)));
  });
}
if (arm) setArm();

// Table and fixtures, told in the work frame.
const around = new THREE.Group();
around.position.set(...origin.map((v) => -v));
for (const [, boxes] of data.standing) boxes.forEach((one) => around.add(cuboid(one, "fixture")));
if (data.standing.length) put("fixtures", around, 0);

// Tool and holder at the flange as they are tested. Where nothing is tested the tool is a rod with its tip at the tool
// centre, as thick as it cuts.
const toolGroup = new THREE.Group();
toolGroup.matrixAutoUpdate = false;
function toolShape() {
  const reach = Math.hypot(...data.tool.flange_from_tool.slice(9));
  const length = Math.min(reach || extent, Math.max(extent * 0.3, 2 * data.tool.diameter));
  const radius = Math.min(data.tool.diameter / 2, length / 4) || 1;
  const tip = Math.min(radius * 1.2, length / 3);
  const parts = [new THREE.ConeGeometry(radius, tip, 64), new THREE.CylinderGeometry(radius, radius, Math.max(length - tip, 1e-3), 64)];
  // Shapes stand along y, the cone's tip up: turned so that the tip is at 0 and the shank along -z.
  parts[0].translate(0, -tip / 2, 0).rotateX(Math.PI / 2);
  parts[1].translate(0, -tip - (length - tip) / 2, 0).rotateX(Math.PI / 2);
  for (const shape of parts) {
    const mesh = new THREE.Mesh(shape, new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.4 }));
    mesh.name = "tool";
    toolGroup.add(mesh);
  }
}
if (!data.tool.bodies.some(([name]) => name === "tool")) toolShape();

// The rod in the cuboid of a tool, along its longest side; its tip is at the tool centre.
function pointed_([pose, half]) {
  const group = new THREE.Group();
  const k = half.indexOf(Math.max(...half));
  const end = [0, 0, 0].map((_, i) => (i === k ? half[k] : 0));
  let [from, to] = [end, end.map((v) => -v)].map((at) => new THREE.Vector3(...at).applyMatrix4(matrixOf(pose)));
  const tip = new THREE.Vector3().setFromMatrixPosition(flangeFromTool);
  if (tip.distanceTo(from) < tip.distanceTo(to)) [from, to] = [to, from];
  const radius = Math.min(...half);
  const neck = to.clone().lerp(from, Math.min((1.2 * 2 * radius) / (2 * half[k]), 0.33));
  group.add(rod(from, neck, radius, radius, "tool"), rod(neck, to, radius, radius * 0.06, "tool"));
  return group;
}
const atFlange = new THREE.Group();
atFlange.matrixAutoUpdate = false;
atFlange.matrix.copy(flangeFromTool).invert();
const bodies = data.tool.bodies.flatMap(([name, boxes]) => boxes.map((one) => [name, one]));
// A tool that is tested is a rod as long as that, pointed where it cuts; a holder is as round as it is wide.
bodies.forEach(([name, one]) => atFlange.add(name === "tool" ? pointed_(one) : body(one, "holder")));
hang("boxes", atFlange, bodies.map(([, one]) => cuboid(one)));
toolGroup.add(atFlange);
put("tool", toolGroup, 7);

function themedArm() {
  scene.traverse(({ name, material }) => {
    if (["arm", "arm-joint", "boxes", "boxes-edge", "tool", "holder", "fixture", "part"].includes(name)) material.color.set(css(name));
  });
}

// Joint values at a time: straight between two samples, as joint motions run; samples on a line are close together.
function jointsAt(time) {
  const count = arm.joints.length;
  const row = indexAt(arm.time, time);
  const next = Math.min(row + 1, arm.time.length - 1);
  const span = arm.time[next] - arm.time[row];
  const share = span > 0 ? Math.min(Math.max((time - arm.time[row]) / span, 0), 1) : 0;
  return Array.from({ length: count }, (_, k) => {
    const from = arm.values[row * count + k];
    return from + (arm.values[next * count + k] - from) * share;
  });
}

// Frames of all links and of a tool in the scene.
function framesOf(values, toolFrame = flangeFromTool) {
  const frames = [arm.base.clone()];
  arm.joints.forEach(([, sliding, , axis], k) => {
    const value = arm.coupling[k].reduce((sum, factor, j) => sum + factor * values[j], 0);
    const along_ = new THREE.Vector3(...axis);
    const turn = sliding
      ? new THREE.Matrix4().makeTranslation(along_.multiplyScalar(value))
      : new THREE.Matrix4().makeRotationAxis(along_, value);
    frames.push(frames[k].clone().multiply(arm.previous[k]).multiply(turn));
  });
  return { frames, tool: frames.at(-1).clone().multiply(arm.flangeFrom).multiply(toolFrame) };
}

// Where the tool centre is at a time, and tool z; between two stations.
function placeAt(time) {
  const row = indexAt(track.time, time);
  const next = Math.min(row + 1, stations - 1);
  const span = track.time[next] - track.time[row];
  const share = span > 0 ? (time - track.time[row]) / span : 0;
  const between = (values) => new THREE.Vector3(...[0, 1, 2].map((k) => values[3 * row + k] + (values[3 * next + k] - values[3 * row + k]) * share));
  return { station: span > 0 && share > 0 ? next : row, at: between(track.position), axis: between(track.axis).normalize() };
}

function poseAt(time) {
  const place = placeAt(time);
  const toolFrame = frameAt(track.event[place.station]);
  atFlange.matrix.copy(toolFrame).invert();
  if (arm) {
    const { frames, tool } = framesOf(jointsAt(time), toolFrame);
    arm.links3.forEach((link, k) => { link.matrix.copy(frames[k]); link.matrixWorldNeedsUpdate = true; });
    toolGroup.matrix.copy(tool);
  } else {
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), place.axis);
    toolGroup.matrix.compose(place.at, turn, new THREE.Vector3(1, 1, 1));
  }
  toolGroup.matrixWorldNeedsUpdate = true;
  return place;
}
