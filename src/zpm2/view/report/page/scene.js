// The cloud drawn with WebGL 2: its surface, patches and boundaries, and which polygon lies at a pixel.
//
// A polygon's number is drawn into a picture of its own, of which the pixel under the pointer is read: exact, and as quick for
// 300,000 triangles as for one, where a ray would have to be tested against all of them.

const PARTS = ["surface", "patches", "tubes"];
const WIDE = 1024; // entries of a row of the table of looks

const VERTEX = `#version 300 es
in vec3 position; in vec3 color; in float id;
uniform mat4 matrix; uniform mat4 turn; uniform sampler2D looks; uniform bool plain;
out vec3 seen; flat out vec3 paint; flat out float number;
void main() {
  seen = (turn * vec4(position, 1.)).xyz; paint = color; number = id;
  gl_Position = matrix * vec4(position, 1.);
  if (id < 0.) return;
  vec4 look = texelFetch(looks, ivec2(int(id) % ${WIDE}, int(id) / ${WIDE}), 0);
  if (look.a == 0.) gl_Position = vec4(2., 2., 2., 1.); // not shown: outside of what is seen
  else if (look.a < 1.) paint = look.rgb * (plain ? .5 : 1.);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 seen; flat in vec3 paint; flat in float number;
uniform float lit; uniform float chosen; uniform bool picking; uniform bool plain;
out vec4 result;
void main() {
  if (picking) {
    float n = number + 1.; // 0: no polygon
    result = vec4(mod(n, 256.), mod(floor(n / 256.), 256.), floor(n / 65536.), 255.) / 255.;
    return;
  }
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float light = plain ? 1. : .45 + .55 * abs(normal.z);
  vec3 base = paint;
  if (number >= 0. && (number == lit || number == chosen)) base = plain ? vec3(0.) : mix(base, vec3(1.), .45);
  result = vec4(base * light, 1.);
}`;

function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}

/** The middle and the size of each polygon, {center, size}, from the part of the data with all patches. */
export function placesOf(part, count) {
  const vertices = new Float32Array(bytes(part.vertices));
  const ids = new Float32Array(bytes(part.ids));
  const boxes = Array.from({ length: count }, () => [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]]);
  ids.forEach((id, row) => {
    if (id < 0) return;
    const [low, high] = boxes[id];
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], vertices[3 * row + k]);
      high[k] = Math.max(high[k], vertices[3 * row + k]);
    }
  });
  return boxes.map(([low, high]) =>
    low[0] > high[0] ? null : { center: low.map((value, k) => (value + high[k]) / 2), size: Math.hypot(...low.map((value, k) => high[k] - value)) },
  );
}

export class Scene {
  /** Throws an `Error` where the browser offers no WebGL 2. parts: of the data. count: of the polygons. */
  constructor(canvas, parts, count) {
    Object.assign(this, { canvas, parts, count });
    this.gl = canvas.getContext("webgl2", { antialias: true });
    if (!this.gl) throw new Error("no WebGL 2");
    this.start();
  }

  /** Gives everything to the graphics card; again when it has lost it. */
  start() {
    const { gl } = this;
    this.program = program(gl);
    gl.useProgram(this.program);
    this.at = Object.fromEntries(["matrix", "turn", "lit", "chosen", "picking", "plain", "looks"].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.drawn = PARTS.map((name) => this.load(this.parts.find((part) => part.name === name)));
    this.target = gl.createFramebuffer();
    [this.targetColor, this.targetDepth] = [gl.createRenderbuffer(), gl.createRenderbuffer()];
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    gl.uniform1i(this.at.looks, 0);
    gl.enable(gl.DEPTH_TEST);
    if (this.looks) this.dress(this.looks);
  }

  load(part) {
    const { gl } = this;
    const array = gl.createVertexArray();
    const faces = new Uint32Array(bytes(part.faces));
    gl.bindVertexArray(array);
    const give = (name, values, size, kind, unit) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      const at = gl.getAttribLocation(this.program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, kind, unit, 0, 0);
    };
    give("position", bytes(part.vertices), 3, gl.FLOAT, false);
    give("color", bytes(part.colors), 3, gl.UNSIGNED_BYTE, true);
    give("id", bytes(part.ids), 1, gl.FLOAT, false);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    return { name: part.name, array, count: faces.length };
  }

  /** looks: of each polygon its own colour (true), another one ([r, g, b], 0 to 255), or null to hide it. */
  dress(looks) {
    this.looks = looks;
    const { gl } = this;
    const rows = Math.max(1, Math.ceil(looks.length / WIDE));
    const table = new Uint8Array(4 * WIDE * rows);
    looks.forEach((look, k) => look && table.set(look === true ? [0, 0, 0, 255] : [...look, 128], 4 * k));
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, WIDE, rows, 0, gl.RGBA, gl.UNSIGNED_BYTE, table);
  }

  /** Fits the picture to its place on the screen. */
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { canvas } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((length) => Math.max(1, Math.round(length * ratio)));
    if (canvas.width === width && canvas.height === height) return;
    [canvas.width, canvas.height] = [width, height];
  }

  /** view: [matrix, turn] of orbit.js. shown: names of parts. lit, chosen: numbers of polygons, -1 for none. */
  paint([matrix, turn], shown, lit, chosen, picking = false) {
    const { gl, at, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0); // the page shows through
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(at.matrix, false, matrix);
    gl.uniformMatrix4fv(at.turn, false, turn);
    gl.uniform1f(at.lit, lit);
    gl.uniform1f(at.chosen, chosen);
    gl.uniform1i(at.picking, picking);
    for (const part of this.drawn) {
      if (!shown[part.name]) continue;
      gl.uniform1i(at.plain, part.name === "tubes");
      gl.bindVertexArray(part.array);
      gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 0);
    }
  }

  /** The number of the polygon at px of the canvas, from its upper left corner; -1 for none. */
  pick(view, shown, x, y) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    for (const [buffer, kind, place] of [[this.targetColor, gl.RGBA8, gl.COLOR_ATTACHMENT0], [this.targetDepth, gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT]]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, kind, canvas.width, canvas.height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
    }
    const [column, row] = [Math.floor(x), canvas.height - 1 - Math.floor(y)];
    const pixel = new Uint8Array(4);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(column, row, 1, 1);
    this.paint(view, shown, -1, -1, true);
    gl.disable(gl.SCISSOR_TEST);
    gl.readPixels(column, row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1;
  }
}

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  return made;
}
