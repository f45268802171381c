// Reading the arrays of a page, which codec.py has written.
const SOLVED = 1, KNOWN = 2, SCALED = 4, TRUE = 8, DEEP = 16;
const FORMAT = "evsdr report 1";

async function inflate(bytes, kind) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream(kind));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Values of a layer, channel after channel.
async function decodeLayer(layer) {
  const text = atob(layer.data), packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const raw = await inflate(packed, "deflate"), wide = layer.bits === 16;
  const size = wide ? raw.length / 2 : raw.length, n = size / layer.n_channel;
  const top = 2 ** layer.bits - 1, step = (layer.high - layer.low) / top, out = new Float32Array(size);
  const back = { linear: (f) => f, log: Math.exp, asinh: (f) => layer.unit * Math.sinh(f) }[layer.scale];
  for (let c = 0; c < layer.n_channel; c++) {
    for (let i = 0, q = 0, k = c * n; i < n; i++, k++) {
      q = (q + (wide ? raw[k] | (raw[size + k] << 8) : raw[k])) & top;
      out[k] = back(layer.low + q * step);
    }
  }
  return out;
}

// A fit to look at: sizes, which pixels have values, and its layers, decoded when first asked for.
async function openReport(contents, name) {
  if (contents.format !== FORMAT) throw new Error(`it is not of the format "${FORMAT}"`);
  const state = Uint8Array.from(await decodeLayer(contents.layers.state), Math.round), asked = {};
  const layer = (key) => (asked[key] ??= key in contents.layers ? decodeLayer(contents.layers[key]) : Promise.resolve(null));
  return fitOf({ ...contents, name, state, layer, has: (key) => key in contents.layers });
}

// Number the stored pixels: `place` is their number by pixel, -1 elsewhere; `pixel` the way back.
function fitOf(fit) {
  const place = new Int32Array(fit.state.length).fill(-1), pixel = [];
  fit.state.forEach((bits, at) => {
    if (bits & SOLVED) place[at] = pixel.push(at) - 1;
  });
  return { ...fit, place, pixel: Int32Array.from(pixel), n: pixel.length };
}
