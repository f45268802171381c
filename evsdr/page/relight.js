// The lamp: Lambert's law for one light, on the maps, in WebGL2.
const SHADE = `
uniform vec3 lamp;       // unit vector toward a far lamp; place of a near one, in the camera's frame
uniform float reach;     // distance of a near lamp from the middle of the object, 0 if it is far
uniform float ambient, gain;
float shade(vec3 normal, vec3 point) {
  vec3 way = reach > 0.0 ? lamp - point : lamp;
  float falloff = reach > 0.0 ? reach * reach / dot(way, way) : 1.0;
  return gain * (ambient + falloff * max(0.0, dot(normal, normalize(way))));
}
vec3 encoded(vec3 v) {
  v = clamp(v, 0.0, 1.0);
  return mix(12.92 * v, 1.055 * pow(max(v, 1e-8), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
}`;
const FLAT_VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID % 2, gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0); }`;
const FLAT_FRAGMENT = `#version 300 es
precision highp float; precision highp sampler2D;
uniform sampler2D normals, points, colours;
out vec4 shown;
${SHADE}
void main() {
  ivec2 size = textureSize(normals, 0);
  ivec2 at = ivec2(int(gl_FragCoord.x), size.y - 1 - int(gl_FragCoord.y));
  vec4 normal = texelFetch(normals, at, 0);
  vec3 v = texelFetch(colours, at, 0).rgb * shade(normal.xyz, texelFetch(points, at, 0).xyz);
  shown = normal.w > 0.0 ? vec4(encoded(v), 1.0) : vec4(0.0);
}`;

function program(gl, vertex, fragment) {
  const whole = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(whole, shader);
  }
  gl.linkProgram(whole);
  if (!gl.getProgramParameter(whole, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(whole) ?? "no program");
  const cache = {};
  return { whole, at: (name) => (cache[name] ??= gl.getUniformLocation(whole, name)) };
}

function setLamp(gl, made, light) {
  gl.useProgram(made.whole);
  gl.uniform3fv(made.at("lamp"), light.near ? light.place : light.direction);
  gl.uniform1f(made.at("reach"), light.near ? light.reach : 0);
  gl.uniform1f(made.at("ambient"), light.ambient);
  gl.uniform1f(made.at("gain"), light.gain);
}

// Gives draw(light) and paint(colours): the picture under a light, of linear colours (three for each stored pixel).
function makeRelight(canvas, fit, normal, points) {
  const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true, antialias: false });
  if (!gl) return null;
  [canvas.width, canvas.height] = [fit.width, fit.height];
  const made = program(gl, FLAT_VERTEX, FLAT_FRAGMENT);
  const fill = (unit, name, value) => {
    const texels = new Float32Array(4 * fit.width * fit.height);
    fit.pixel.forEach((at, i) => texels.set(value(i), 4 * at));
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, fit.width, fit.height, 0, gl.RGBA, gl.FLOAT, texels);
    gl.useProgram(made.whole);
    gl.uniform1i(made.at(name), unit);
  };
  const n = fit.n;
  fill(0, "normals", (i) => [normal[i], normal[n + i], normal[2 * n + i], 1]);
  fill(1, "points", (i) => (points ? [points[3 * i], points[3 * i + 1], points[3 * i + 2], 1] : NOTHING));
  const texels = new Float32Array(4 * fit.width * fit.height);
  fill(2, "colours", () => NOTHING);
  const upload = (colours) => {
    fit.pixel.forEach((at, i) => texels.set(colours.subarray(3 * i, 3 * i + 3), 4 * at));
    gl.activeTexture(gl.TEXTURE2);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, fit.width, fit.height, gl.RGBA, gl.FLOAT, texels);
  };
  const draw = (light) => {
    setLamp(gl, made, light);
    gl.viewport(0, 0, fit.width, fit.height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  };
  // Bytes of the last picture, row 0 the top
  const read = () => {
    const bytes = new Uint8Array(4 * fit.width * fit.height), row = 4 * fit.width, out = new Uint8Array(bytes.length);
    gl.readPixels(0, 0, fit.width, fit.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    for (let y = 0; y < fit.height; y++) out.set(bytes.subarray(y * row, (y + 1) * row), (fit.height - 1 - y) * row);
    return out;
  };
  return { draw, paint: upload, read };
}

// Points of the surface in the camera's frame, three numbers for each stored pixel; null without depth.
async function surfacePoints(fit) {
  const depth = await fit.layer("depth");
  if (!depth) return null;
  const { perspective, pixel_size, center } = fit.camera, out = new Float32Array(3 * fit.n);
  fit.pixel.forEach((at, i) => {
    const scale = perspective ? depth[i] : 1, x = at % fit.width, y = Math.floor(at / fit.width);
    out[3 * i] = (x + 0.5 - center[0]) * pixel_size[0] * scale;
    out[3 * i + 1] = (center[1] - y - 0.5) * pixel_size[1] * scale;
    out[3 * i + 2] = -depth[i];
  });
  return out;
}

// Middle and radius of what is known of the surface.
function extent(fit, points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  fit.pixel.forEach((at, i) => {
    if (!(fit.state[at] & DEEP)) return;
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], points[3 * i + k]);
      high[k] = Math.max(high[k], points[3 * i + k]);
    }
  });
  if (!(high[0] >= low[0])) return null;
  const radius = Math.hypot(...high.map((v, k) => (v - low[k]) / 2)) || 1;
  return { middle: high.map((v, k) => (v + low[k]) / 2), radius };
}
