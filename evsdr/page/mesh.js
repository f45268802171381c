// The surface in three dimensions: triangles of the pixels, turned and lit in WebGL2.
const SOLID_VERTEX = `#version 300 es
in vec3 point, normal, colour;
uniform mat3 turn;
uniform vec3 middle;
uniform vec2 window;     // half width and height of what is seen, in units of the surface
uniform float depth, relief;
out vec3 at, facing, tint;
void main() {
  vec3 drawn = vec3(1.0, 1.0, relief);
  at = turn * ((point - middle) * drawn);
  facing = turn * normalize(normal / drawn);
  tint = colour;
  gl_Position = vec4(at.xy / window, -at.z / depth, 1.0);
}`;
const SOLID_FRAGMENT = `#version 300 es
precision highp float;
in vec3 at, facing, tint;
uniform bool lit;
uniform vec3 middle;
out vec4 shown;
${SHADE}
void main() {
  if (!gl_FrontFacing) { shown = vec4(vec3(0.32), 1.0); return; }
  vec3 v = lit ? tint * shade(normalize(facing), at + middle) : tint;
  shown = vec4(encoded(v), 1.0);
}`;

// Triangles between neighbours that lie on one surface, as mesh.py cuts them.
function triangles(fit, ties, points) {
  const out = [], w = fit.width, square = (i, j) => [0, 1, 2].reduce((s, k) => s + (points[3 * i + k] - points[3 * j + k]) ** 2, 0);
  const numbered = (at) => (fit.state[at] & DEEP ? fit.place[at] : -1);
  const tied = (i, j, bit) => i >= 0 && j >= 0 && ties[i] & bit;
  for (let y = 0; y + 1 < fit.height; y++) {
    for (let x = 0; x + 1 < w; x++) {
      const at = y * w + x, [a, b, c, d] = [at, at + 1, at + w, at + w + 1].map(numbered);
      const [upper, lower, left, right] = [tied(a, b, 1), tied(c, d, 1), tied(a, c, 2), tied(b, d, 2)];
      const falling = !!(left && lower) + !!(upper && right), rising = !!(left && upper) + !!(lower && right);
      if (!falling && !rising) continue;
      if (falling > rising || (falling === rising && square(a, d) <= square(b, c))) {
        if (left && lower) out.push(a, c, d);
        if (upper && right) out.push(a, d, b);
      } else {
        if (left && upper) out.push(a, c, b);
        if (lower && right) out.push(c, d, b);
      }
    }
  }
  return Uint32Array.from(out);
}

function makeMesh(canvas, fit, normal, points, ties) {
  const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true, antialias: true });
  const size = gl && points && extent(fit, points);
  if (!size) return null;
  const made = program(gl, SOLID_VERTEX, SOLID_FRAGMENT), face = triangles(fit, ties, points);
  const fill = (name, values) => {
    const place = gl.getAttribLocation(made.whole, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
  };
  const woven = new Float32Array(3 * fit.n);
  for (let i = 0; i < fit.n; i++) for (let k = 0; k < 3; k++) woven[3 * i + k] = normal[k * fit.n + i];
  fill("point", points);
  fill("normal", woven);
  fill("colour", new Float32Array(3 * fit.n));
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, face, gl.STATIC_DRAW);
  gl.enable(gl.DEPTH_TEST);
  const tint = (colours) => gl.bufferData(gl.ARRAY_BUFFER, colours, gl.DYNAMIC_DRAW); // its buffer was bound last
  const draw = (view, light) => {
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * devicePixelRatio)));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    setLamp(gl, made, light);
    const half = (1.02 * size.radius) / view.zoom, least = Math.min(w, h);
    gl.uniformMatrix3fv(made.at("turn"), false, turned(view.yaw, view.pitch));
    gl.uniform3fv(made.at("middle"), size.middle);
    gl.uniform2f(made.at("window"), (half * w) / least, (half * h) / least);
    gl.uniform1f(made.at("depth"), size.radius * Math.max(1, view.relief) * 1.1);
    gl.uniform1f(made.at("relief"), view.relief);
    gl.uniform1i(made.at("lit"), view.lit ? 1 : 0);
    gl.drawElements(gl.TRIANGLES, face.length, gl.UNSIGNED_INT, 0);
  };
  return { draw, tint, face, size };
}

// Turn about the upright axis, then tip toward the viewer; column after column.
function turned(yaw, pitch) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return [cy, sp * sy, -cp * sy, 0, cp, sp, sy, -sp * cy, cp * cy];
}
