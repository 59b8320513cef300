// The robot, link by link, and the tool that moves along the program.
const arm = data.arm && {
  ...data.arm, values: unpack(data.arm.values), time: unpack(data.arm.time), links3: [],
  base: product(moveBy(scaled(origin, -1)), matrixOf(data.arm.work_from_base)),
  flangeFrom: matrixOf(data.arm.flange), previous: data.arm.joints.map((joint) => matrixOf(joint[2])),
  size: data.arm.joints.reduce((sum, joint) => sum + Math.hypot(...joint[2].slice(9)), 0),
};
const flangeFromTool = matrixOf(data.tool.flange_from_tool);
// Of each tool where there are several.
const toolFrames = data.tools?.map((tool) => matrixOf(tool.flange_from_tool)) ?? [flangeFromTool];
const frameAt = (event) => toolFrames[toolOf ? toolOf[event] : 0];

function cuboid([pose, half], name = "arm") {
  const tested = name === "arm";
  const rest = tested ? { opacity: 0.35, depthWrite: false, offset: [-1, -4] } : PUSHED;
  const faces = solid(boxShape(half), { name: tested ? "boxes" : name, oneSided: true, ...rest });
  const edges = solid(boxEdges(half), { name: tested ? "boxes-edge" : "part", shine: 0, opacity: 0.55 });
  return thing({ matrix: matrixOf(pose), parts: [faces, edges] });
}

// A thing of a layer that moves with another one.
function hang(layer, parent, things) {
  const group = thing({ parts: things });
  parent.parts.push(group);
  layers[layer].things.push(group);
}

// Cuboids of one frame told in another: from_ is where the first stands in the second.
const toldFrom = (from_, boxes) => boxes.map(([pose, half]) => {
  const m = product(from_, matrixOf(pose));
  return [[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10], m[12], m[13], m[14]], half];
});

function setArm() {
  const start = [0, 0, 0];
  arm.links.forEach(([, boxes, mesh], k) => {
    const link = thing();
    scene.parts.push(link);
    arm.links3.push(link);
    const [own, next] = [arm.joints[k - 1], arm.joints[k]];
    const entry = own && { at: start, axis: unit(own[3]), sliding: own[1] };
    const exit = next && { at: moved(arm.previous[k], start), sliding: next[1] };
    const before = k ? toldFrom(inverse(arm.previous[k - 1]), arm.links[k - 1][1]) : [];
    hang("robot", link, mesh ? [linkMesh(mesh)] : linkShapes(boxes, entry, exit, before));
    hang("boxes", link, boxes.map((one) => cuboid(one)));
  });
}
if (arm) setArm();

// Table and fixtures, told in the work frame.
const around = thing({ matrix: moveBy(scaled(origin, -1)) });
for (const [, boxes] of data.standing) around.parts.push(...boxes.map((one) => cuboid(one, "fixture")));
if (data.standing.length) put("fixtures", around, 0);

// Tool and holder at the flange as they are tested. Where nothing is tested the tool is a rod with its tip at the tool
// centre, as thick as it cuts.
const toolGroup = thing();
const SEEN_THROUGH = { opacity: 0.4 };
function toolShape() {
  const reach = Math.hypot(...data.tool.flange_from_tool.slice(9));
  const length = Math.min(reach || extent, Math.max(extent * 0.3, 2 * data.tool.diameter));
  const radius = Math.min(data.tool.diameter / 2, length / 4) || 1;
  const tip = Math.min(radius * 1.2, length / 3);
  const neck = [0, 0, -tip];
  toolGroup.parts.push(rod(neck, [0, 0, 0], radius, 0, "tool", SEEN_THROUGH, 64));
  toolGroup.parts.push(rod([0, 0, Math.min(-length, -tip - 1e-3)], neck, radius, radius, "tool", SEEN_THROUGH, 64));
}
if (!data.tool.bodies.some(([name]) => name === "tool")) toolShape();

// The rod in the cuboid of a tool, along its longest side; its tip is at the tool centre.
function pointed_([pose, half]) {
  const k = half.indexOf(Math.max(...half));
  const end = [0, 0, 0].map((_, i) => (i === k ? half[k] : 0));
  let [from, to] = [end, end.map((v) => -v)].map((at) => moved(matrixOf(pose), at));
  const tip = placeOf(flangeFromTool);
  if (sizeOf(minus(tip, from)) < sizeOf(minus(tip, to))) [from, to] = [to, from];
  const radius = Math.min(...half);
  const neck = onward(to, minus(from, to), Math.min((1.2 * 2 * radius) / (2 * half[k]), 0.33));
  return [rod(from, neck, radius, radius, "tool"), rod(neck, to, radius, radius * 0.06, "tool")];
}
const atFlange = thing({ matrix: inverse(flangeFromTool) });
const bodies = data.tool.bodies.flatMap(([name, boxes]) => boxes.map((one) => [name, one]));
// A tool that is tested is a rod as long as that, pointed where it cuts; a holder is as round as it is wide.
atFlange.parts.push(...bodies.flatMap(([name, one]) => (name === "tool" ? pointed_(one) : [body(one, "holder")])));
hang("boxes", atFlange, bodies.map(([, one]) => cuboid(one)));
toolGroup.parts.push(atFlange);
put("tool", toolGroup, 7);

// The things that have the colour of their name, wherever they hang.
const NAMED = ["arm", "arm-joint", "boxes", "boxes-edge", "tool", "holder", "fixture", "part", "solid", "plate"];
function themeNamed() {
  const colours = Object.fromEntries(NAMED.map((name) => [name, colourOf(css(name))]));
  const visit = ({ name, draw, parts }) => {
    if (draw && colours[name]) paintSolid(draw, colours[name]);
    parts.forEach(visit);
  };
  visit(scene);
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
  const frames = [arm.base];
  arm.joints.forEach(([, sliding, , axis], k) => {
    const value = arm.coupling[k].reduce((sum, factor, j) => sum + factor * values[j], 0);
    const turn = sliding ? moveBy(scaled(axis, value)) : turnAbout(axis, value);
    frames.push(product(product(frames[k], arm.previous[k]), turn));
  });
  return { frames, tool: product(product(frames.at(-1), arm.flangeFrom), toolFrame) };
}

// Where the tool centre is at a time, and tool z; between two stations.
function placeAt(time) {
  const row = indexAt(track.time, time);
  const next = Math.min(row + 1, stations - 1);
  const span = track.time[next] - track.time[row];
  const share = span > 0 ? (time - track.time[row]) / span : 0;
  const between = (values) => [0, 1, 2].map((k) => values[3 * row + k] + (values[3 * next + k] - values[3 * row + k]) * share);
  return { station: span > 0 && share > 0 ? next : row, at: between(track.position), axis: unit(between(track.axis)) };
}

function poseAt(time) {
  const place = placeAt(time);
  const toolFrame = frameAt(track.event[place.station]);
  atFlange.matrix = inverse(toolFrame);
  if (arm) {
    const { frames, tool } = framesOf(jointsAt(time), toolFrame);
    arm.links3.forEach((link, k) => { link.matrix = frames[k]; });
    toolGroup.matrix = tool;
  } else {
    toolGroup.matrix = product(moveBy(place.at), turnTo3([0, 0, 1], place.axis));
  }
  return place;
}
