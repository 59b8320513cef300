// What is drawn, by WebGL 2: programs, textures, bodies, and the picture of them. A browser may take all that a graphics
// card holds and give it back empty: everything is made where it is drawn first, and made again then.
const $ = (id) => document.getElementById(id);
const canvas = $("canvas");
const pixelRatio = () => Math.min(devicePixelRatio, 2);

// The size comes first: a new one for a canvas that has a context costs as much as the context.
function sizeCanvas() {
  const size = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(Math.floor(v * pixelRatio()), 1));
  if (canvas.width !== size[0]) canvas.width = size[0];
  if (canvas.height !== size[1]) canvas.height = size[1];
}
sizeCanvas();
const gl = canvas.getContext("webgl2", { antialias: false, depth: true, stencil: true });

// Where there is no graphics card, pictures take ten times as long.
function isSoftware() {
  let name = gl.getParameter(gl.RENDERER);
  if (name === "WebKit WebGL") name = gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
const isDrawnByProcessor = Boolean(gl) && isSoftware();

// Counts how often all was lost.
let age = 0;
function kept(make) {
  let [made, held] = [-1, null];
  return () => {
    if (made !== age) [made, held] = [age, make()];
    return held;
  };
}

canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
canvas.addEventListener("webglcontextrestored", () => { age++; });

// Compiled at once and looked at when it is drawn with: meanwhile the browser works on it.
function program(vertex, fragment) {
  const own = kept(() => {
    const handle = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, `#version 300 es\nprecision highp float;\nprecision highp int;\n${text}`);
      gl.compileShader(shader);
      gl.attachShader(handle, shader);
    }
    gl.linkProgram(handle);
    return { handle, uniforms: null };
  });
  if (gl) own();
  return own;
}

function uniformsOf(made) {
  if (made.uniforms) return made.uniforms;
  const { handle } = made;
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error([gl.getProgramInfoLog(handle), ...gl.getAttachedShaders(handle).map((one) => gl.getShaderInfoLog(one))].join("\n"));
  }
  const count = gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS);
  made.uniforms = Array.from({ length: count }, (_, k) => {
    const { name, type } = gl.getActiveUniform(handle, k);
    return { name, type, place: gl.getUniformLocation(handle, name) };
  });
  return made.uniforms;
}

// A texture of four numbers a texel. `values` may change; `changed` says from which row on to which.
function table(values, width, height) {
  const own = { values, high: height, changed: null };
  own.handle = kept(() => {
    const handle = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, handle);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, own.values);
    own.changed = null;
    return handle;
  });
  own.bind = () => {
    gl.bindTexture(gl.TEXTURE_2D, own.handle());
    if (!own.changed) return;
    const [from, to] = own.changed;
    const rows = own.values.subarray(4 * width * from, 4 * width * (to + 1));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from, width, to + 1 - from, gl.RGBA, gl.FLOAT, rows);
    own.changed = null;
  };
  return own;
}

// A picture, smooth from afar and from near.
function pictureTexture(image) {
  const handle = kept(() => {
    const made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    return made;
  });
  return { bind: () => gl.bindTexture(gl.TEXTURE_2D, handle()) };
}

function buffer(target, values) {
  return kept(() => {
    const handle = gl.createBuffer();
    gl.bindVertexArray(null);
    gl.bindBuffer(target(), handle);
    gl.bufferData(target(), values, gl.STATIC_DRAW);
    return handle;
  });
}
const indexBuffer = (values) => buffer(() => gl.ELEMENT_ARRAY_BUFFER, values);

// Corners (Float32Array, three numbers each) and normals of a body, and how they are put together; `index` may be one
// that others have too, and none means corner by corner.
function shape({ points, normals, index, indexes = index && indexBuffer(index), lines: asLines = false, count }) {
  const columns = [points, normals].map((values) => values && buffer(() => gl.ARRAY_BUFFER, values));
  const vertices = kept(() => {
    const buffers = columns.map((one) => one?.());
    const around = indexes?.();
    const handle = gl.createVertexArray();
    gl.bindVertexArray(handle);
    buffers.forEach((one, place) => {
      if (!one) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, one);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    });
    if (around) gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, around);
    return handle;
  });
  return { vertices, indexed: Boolean(indexes), asLines, count: count ?? (index ? index.length : points.length / 3), points, index };
}

// Something in the scene: where it stands in what it hangs on, and how it is drawn where it is. order: what comes last
// lies over the others; things that one sees through come after all others.
function thing({ name = "", matrix = HERE, order = 0, draw = null, parts = [] } = {}) {
  return { name, matrix, order, draw, parts, visible: true };
}

// How a thing is drawn: its shape, a program and what that is told; the rest has its usual values. ranges: the corners that
// are drawn, where it is not all of them.
const drawing = (shape_, program_, uniforms, rest = {}) => ({
  shape: shape_, program: program_, uniforms, clear: false, oneSided: false, depthTest: true, depthWrite: true, offset: null, stencil: "", ...rest,
});

// All that is seen, with where it stands in the scene: what one does not see through, and what comes over it.
function visibleThings(root) {
  const [solid, clear] = [[], []];
  const visit = (one, from, order) => {
    if (!one.visible) return;
    const world = one.matrix === HERE ? from : product(from, one.matrix);
    const own = one.order || order;
    if (one.draw) (one.draw.clear ? clear : solid).push({ draw: one.draw, world, order: own });
    for (const part of one.parts) visit(part, world, own);
  };
  visit(root, HERE, 0);
  for (const list of [solid, clear]) list.sort((a, b) => a.order - b.order);
  return [...solid, ...clear];
}

const SETTERS = {
  0x1404: "uniform1i", 0x1406: "uniform1f", 0x8b50: "uniform2fv", 0x8b51: "uniform3fv", 0x8b52: "uniform4fv",
};
function tellProgram({ program: own, uniforms }, own_) {
  const made = own();
  gl.useProgram(made.handle);
  let unit_ = 0;
  for (const { name, type, place } of uniformsOf(made)) {
    const value = own_[name] ?? uniforms[name].value;
    if (type === gl.SAMPLER_2D) {
      gl.activeTexture(gl.TEXTURE0 + unit_);
      value.bind();
      gl.uniform1i(place, unit_++);
    } else if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(place, false, value);
    else gl[SETTERS[type]](place, value);
  }
}

// stencil "odd": every triangle turns it over, nothing else is drawn; "inside": only where it is odd.
function setState({ clear, oneSided, depthTest, depthWrite, offset, stencil }) {
  const turn = (on, what) => (on ? gl.enable(what) : gl.disable(what));
  turn(clear, gl.BLEND);
  turn(oneSided, gl.CULL_FACE);
  turn(depthTest, gl.DEPTH_TEST);
  gl.depthMask(depthWrite);
  turn(Boolean(offset), gl.POLYGON_OFFSET_FILL);
  if (offset) gl.polygonOffset(...offset);
  turn(Boolean(stencil), gl.STENCIL_TEST);
  gl.colorMask(stencil !== "odd", stencil !== "odd", stencil !== "odd", true);
  if (!stencil) return;
  gl.stencilMask(stencil === "odd" ? 1 : 0);
  gl.stencilFunc(stencil === "odd" ? gl.ALWAYS : gl.NOTEQUAL, 0, 1);
  const done = stencil === "odd" ? gl.INVERT : gl.KEEP;
  gl.stencilOp(done, done, done);
}

// Where a picture with smooth borders is drawn before it is shown.
const sheet = { age: -1 };
function smoothSheet(wide, high) {
  if (sheet.age === age && sheet.wide === wide && sheet.high === high) return sheet.handle;
  if (sheet.age === age) {
    gl.deleteFramebuffer(sheet.handle);
    for (const one of sheet.buffers) gl.deleteRenderbuffer(one);
  }
  const handle = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, handle);
  const samples = Math.min(4, gl.getParameter(gl.MAX_SAMPLES));
  const buffers = [[gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_STENCIL_ATTACHMENT, gl.DEPTH24_STENCIL8]].map(([place, format]) => {
    const one = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, one);
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, wide, high);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, one);
    return one;
  });
  return Object.assign(sheet, { age, wide, high, handle, buffers }).handle;
}

// The scene as `whole` (the way from it to the picture) shows it, with smooth borders or, sooner, without.
function drawScene(root, whole, back, smooth) {
  if (gl.isContextLost()) return;
  const [wide, high] = [canvas.width, canvas.height];
  gl.bindFramebuffer(gl.FRAMEBUFFER, smooth ? smoothSheet(wide, high) : null);
  gl.viewport(0, 0, wide, high);
  gl.depthMask(true);
  gl.stencilMask(1);
  gl.colorMask(true, true, true, true);
  gl.clearColor(...back, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  gl.depthFunc(gl.LEQUAL);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  for (const { draw, world } of visibleThings(root)) {
    const { shape: { vertices, indexed, asLines, count } } = draw;
    setState(draw);
    gl.bindVertexArray(vertices());
    tellProgram(draw, { clip: world === HERE ? whole : product(whole, world), world });
    const mode = asLines ? gl.LINES : gl.TRIANGLES;
    for (const [from, to] of draw.ranges ?? [[0, count]]) {
      if (indexed) gl.drawElements(mode, to - from, gl.UNSIGNED_INT, 4 * from);
      else gl.drawArrays(mode, from, to - from);
    }
  }
  if (!smooth) return;
  gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
  gl.blitFramebuffer(0, 0, wide, high, 0, 0, wide, high, gl.COLOR_BUFFER_BIT, gl.NEAREST);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
}
