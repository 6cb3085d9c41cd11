// The 3D view: bodies, ghosts and lines by WebGL, seen by a camera that turns about a point.
const VERTEX = `
attribute vec3 point; attribute vec3 normal;
uniform mat4 model, camera; varying vec3 facing, place;
void main() {
  vec4 world = model * vec4(point, 1.0);
  facing = mat3(model) * normal; place = world.xyz;
  gl_Position = camera * world;
}`;
const FRAGMENT = `
precision mediump float;
uniform vec4 color; uniform float lit, stripes; varying vec3 facing, place;
void main() {
  float light = 0.55 + 0.45 * abs(dot(normalize(facing), normalize(vec3(0.4, 0.3, 0.85))));
  // Stripes tell what collides from what does not, without colour.
  float dark = stripes > 0.5 && fract((place.x + place.y + place.z) * 22.0) < 0.4 ? 0.45 : 1.0;
  gl_FragColor = vec4(color.rgb * mix(1.0, light, lit) * dark, color.a);
}`;
// The frame of a body: of its joint, or by its name where it is carried by turns or moves as a finger.
function frameOf(body, frames) {
  if (body.kind === "moved") return frames[body.name];
  return frames[`finger ${body.name}`] || frames[body.joint];
}
class View {
  constructor(canvas, data) {
    this.canvas = canvas;
    const gl = canvas.getContext("webgl", { alpha: false, antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL");
    this.gl = gl;
    gl.getExtension("OES_element_index_uint");
    this.program = program(gl);
    this.at = {};
    for (const name of ["model", "camera", "color", "lit", "stripes"]) {
      this.at[name] = gl.getUniformLocation(this.program, name);
    }
    this.bodies = data.bodies.map((body) => this.upload(body));
    this.line = gl.createBuffer();
    this.reset();
    this.listen();
  }
  upload(body) {
    const gl = this.gl, bytes = decode(body.faces);
    const corners = new Float32Array(decode(body.vertices).buffer);
    const faces = body.wide ? new Uint32Array(bytes.buffer) : new Uint16Array(bytes.buffer);
    // Flat shading: every triangle has corners of its own.
    const points = new Float32Array(3 * faces.length), normals = new Float32Array(3 * faces.length);
    let low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => [0, 1, 2].map((i) => corners[3 * faces[f + k] + i]));
      const normal = unit(cross(minus(b, a), minus(c, a)));
      [a, b, c].forEach((corner, k) => {
        points.set(corner, 3 * (f + k));
        normals.set(normal, 3 * (f + k));
        low = low.map((v, i) => Math.min(v, corner[i]));
        high = high.map((v, i) => Math.max(v, corner[i]));
      });
    }
    return { name: body.name, kind: body.kind, joint: body.joint, color: body.color, low, high, count: faces.length,
             points: buffer(gl, points), normals: buffer(gl, normals) };
  }
  reset() { this.yaw = -0.9; this.pitch = 0.45; this.distance = 2.6; this.target = [0.2, 0, 0.4]; this.changed = true; }
  listen() {
    let last = null;
    const canvas = this.canvas;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      last = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointerup", () => { last = null; });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      const dx = event.clientX - last[0], dy = event.clientY - last[1];
      last = [event.clientX, event.clientY];
      if (event.shiftKey || event.buttons & 2) this.move(dx, dy); else this.turn(-dx * 0.008, dy * 0.008);
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.zoom(Math.exp(event.deltaY * 0.001)); }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
      if (turns[event.key]) this.turn(...turns[event.key]);
      else if (event.key === "+") this.zoom(0.9);
      else if (event.key === "-") this.zoom(1.1);
      else if (event.key === "0") this.reset();
      else return;
      event.preventDefault(); event.stopPropagation();
    });
  }
  turn(yaw, pitch) { this.yaw += yaw; this.pitch = Math.min(Math.max(this.pitch + pitch, -1.5), 1.5); this.changed = true; }
  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, 0.1), 50); this.changed = true; }
  move(dx, dy) {
    const k = this.distance * 0.0012, side = [-Math.sin(this.yaw), Math.cos(this.yaw), 0];
    this.target = plus(this.target, plus(times(side, -dx * k), [0, 0, dy * k])); this.changed = true;
  }
  begin() {
    const gl = this.gl, canvas = this.canvas, ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.93, 0.945, 0.96, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    const c = Math.cos(this.pitch);
    const away = [c * Math.cos(this.yaw), c * Math.sin(this.yaw), Math.sin(this.pitch)];
    const eye = plus(this.target, times(away, this.distance));
    const camera = Matrix.multiply(Matrix.perspective(0.8, width / Math.max(height, 1), 0.02, 100), Matrix.lookAt(eye, this.target, [0, 0, 1]));
    gl.uniformMatrix4fv(this.at.camera, false, camera);
    this.camera = camera;
  }
  // Where a point is seen, as shares of width and height; null behind the camera.
  project(point) {
    const row = (i) => this.camera[i] * point[0] + this.camera[4 + i] * point[1] + this.camera[8 + i] * point[2] + this.camera[12 + i];
    return row(3) > 0 ? [0.5 + row(0) / (2 * row(3)), 0.5 - row(1) / (2 * row(3))] : null;
  }
  // The middle of a body where the frames are.
  middle(body, frames) {
    const T = frameOf(body, frames), p = times(plus(body.low, body.high), 0.5);
    return [0, 1, 2].map((i) => T[i] * p[0] + T[4 + i] * p[1] + T[8 + i] * p[2] + T[12 + i]);
  }
  // Draw bodies where the frames of their joints are.
  draw(frames, { only, color, alpha = 1, striped = () => false }) {
    const gl = this.gl, clear = alpha < 1;
    if (clear) { gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA); gl.depthMask(false); }
    gl.uniform1f(this.at.lit, 1);
    for (const body of this.bodies) {
      if (!only(body)) continue;
      gl.uniformMatrix4fv(this.at.model, false, frameOf(body, frames));
      gl.uniform4f(this.at.color, ...color(body), alpha);
      gl.uniform1f(this.at.stripes, striped(body) ? 1 : 0);
      bind(gl, this.program, "point", body.points);
      bind(gl, this.program, "normal", body.normals);
      gl.drawArrays(gl.TRIANGLES, 0, body.count);
    }
    if (clear) { gl.disable(gl.BLEND); gl.depthMask(true); }
  }
  lines(points, color, closed = false) {
    const gl = this.gl;
    if (points.length < 2) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.line);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points.flat()), gl.DYNAMIC_DRAW);
    this.strokes(this.line, points.length, color, closed);
  }
  // Lines that stay: pieces of k edges with some points each; dashed ones leave out every second piece.
  edges(text, dashed) {
    const points = new Float32Array(decode(text).buffer), ends = [], each = 4;
    for (let edge = 0; edge < points.length / (3 * each); edge++) {
      for (let piece = 0; piece + 1 < each; piece += dashed ? 2 : 1) {
        const at = 3 * (edge * each + piece);
        ends.push(...points.subarray(at, at + 6));
      }
    }
    return { buffer: buffer(this.gl, new Float32Array(ends)), count: ends.length / 3 };
  }
  strokes(line, count, color, closed) {
    const gl = this.gl;
    gl.uniformMatrix4fv(this.at.model, false, Matrix.identity());
    gl.uniform4f(this.at.color, ...color, 1);
    gl.uniform1f(this.at.lit, 0);
    gl.uniform1f(this.at.stripes, 0);
    bind(gl, this.program, "point", line);
    const normal = gl.getAttribLocation(this.program, "normal");
    gl.disableVertexAttribArray(normal);
    gl.vertexAttrib3f(normal, 0, 0, 1);
    gl.drawArrays(closed ? gl.LINES : gl.LINE_STRIP, 0, count);
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
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}
function buffer(gl, values) {
  const made = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, made);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  return made;
}
function bind(gl, program, name, values) {
  const at = gl.getAttribLocation(program, name);
  gl.bindBuffer(gl.ARRAY_BUFFER, values);
  gl.enableVertexAttribArray(at);
  gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
}
function decode(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}
