// Colours and numbers as people read them.
const encode = (v) => (v <= 0.0031308 ? 12.92 * Math.max(v, 0) : 1.055 * Math.min(v, 1) ** (1 / 2.4) - 0.055);
const css = (rgb) => `rgb(${rgb.map((v) => Math.round(255 * Math.min(Math.max(v, 0), 1))).join(" ")})`;
const say = (v, digits = 3) => String(Number(v.toPrecision(digits))).replace("-", "−");

// OKLab (Ottosson 2020) to linear sRGB.
function fromOklab(L, a, b) {
  const [l, m, s] = [L + 0.3963377774 * a + 0.2158037573 * b, L - 0.1055613458 * a - 0.0638541728 * b, L - 0.0894841775 * a - 1.291485548 * b].map((v) => v ** 3);
  return [4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s, -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s, -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s];
}

// 256 colours (bytes) from dark to bright, of lightness that rises evenly, so that they also work in grey.
function makeRamp(from, to, hueFrom, hueTo, chroma) {
  const out = new Uint8Array(768);
  for (let i = 0; i < 256; i++) {
    const t = i / 255, hue = ((hueFrom + (hueTo - hueFrom) * t) * Math.PI) / 180, c = chroma * Math.sin(Math.PI * (0.08 + 0.84 * t)) ** 0.8;
    fromOklab(from + (to - from) * t, c * Math.cos(hue), c * Math.sin(hue)).forEach((v, k) => (out[3 * i + k] = Math.round(255 * encode(v))));
  }
  return out;
}
const RAMPS = {
  grey: Uint8Array.from({ length: 768 }, (_, i) => Math.floor(i / 3)),
  heat: makeRamp(0.16, 0.97, -75, 100, 0.19), // violet, red, orange, pale yellow
  sea: makeRamp(0.22, 0.95, 275, 130, 0.13), // blue, green, pale
};
