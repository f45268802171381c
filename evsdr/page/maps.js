// The maps that a fit has, and how each becomes a picture.
const NOTHING = [0, 0, 0, 0];

// Each map: id, name, words; either `values` (fit -> numbers of the stored pixels) with unit, ramp and range, or `colours`
// (fit -> bytes, three for each stored pixel). `bit` says for which pixels it holds.
function mapsOf(fit) {
  const nm = fit.wavelength_nm, order = nm.map((_, b) => b).sort((a, b) => nm[a] - nm[b]);
  const band = (key, b) => async () => (await fit.layer(key)).subarray(b * fit.n, (b + 1) * fit.n);
  const from = (key) => () => fit.layer(key);
  const maps = [
    { id: "normal", name: "Normals", words: "Red is right, green is up, blue is toward the camera.", bit: KNOWN, needs: "normal", colours: async () => normalColours(await fit.layer("normal"), fit.n) },
    { id: "colour", name: "Colour under daylight", words: "Reflectance under D65, as the CIE 1931 observer sees it.", bit: KNOWN, needs: fit.daylight ? "reflectance" : "?", colours: async () => eyeColours(fit, await fit.layer("reflectance")) },
    ...order.map((b) => ({ id: `band_${b}`, name: `Reflectance at ${nm[b].toFixed(0)} nm`, words: "Absolute reflectance: 1 is a white matt surface.", bit: KNOWN, needs: "reflectance", ramp: "grey", values: band("reflectance", b), zero: true })),
    { id: "sigma", name: "Uncertainty of normals", words: "One standard deviation of the normal's angle.", unit: "°", bit: KNOWN, needs: "normal_sigma_deg", ramp: "heat", values: from("normal_sigma_deg"), zero: true },
    { id: "reflectance_sigma", name: "Uncertainty of reflectance", words: "One standard deviation, mean over the bands.", bit: KNOWN, needs: "reflectance_sigma", ramp: "heat", values: async () => meanOver(await fit.layer("reflectance_sigma"), fit.n), zero: true },
    { id: "known", name: "What is known", words: "", legend: KINDS, bit: SOLVED, needs: "normal", colours: async () => kindColours(fit) },
    { id: "residual", name: "Residual", words: "What the maps leave unexplained of an event: the scatter of its change of log light, relative to the threshold.", bit: SOLVED, needs: "residual", ramp: "heat", values: from("residual"), zero: true },
    { id: "events", name: "Pairs of events", words: "Pairs of successive events of each pixel.", bit: SOLVED, needs: "events", ramp: "sea", values: from("events"), zero: true },
    { id: "depth", name: "Depth", words: "Distance from the camera along its axis, in the unit of the scene.", bit: DEEP, needs: "depth", ramp: "sea", values: from("depth"), flip: true },
    { id: "angle_deg", name: "Error of normals", words: "Angle to the true normal.", unit: "°", bit: TRUE, needs: "angle_deg", ramp: "heat", values: from("angle_deg"), zero: true },
    { id: "rmse", name: "Error of reflectance", words: "Root mean square over bands of the difference to the truth.", bit: TRUE, needs: "rmse", ramp: "heat", values: from("rmse"), zero: true },
    ...order.map((b) => ({ id: `sigma_${b}`, name: `Uncertainty at ${nm[b].toFixed(0)} nm`, words: "One standard deviation of the reflectance.", bit: KNOWN, needs: "reflectance_sigma", ramp: "heat", values: band("reflectance_sigma", b), zero: true, aside: true })),
  ];
  return maps.filter((map) => fit.has(map.needs));
}

// What is known, by the bits of the state.
const KINDS = [
  [(bits) => bits & KNOWN && bits & SCALED, [0.27, 0.62, 0.52], "normal and reflectance known"],
  [(bits) => bits & KNOWN, [0.93, 0.72, 0.28], "normal known, but not how bright it is"],
  [(bits) => bits & SOLVED, [0.78, 0.33, 0.3], "neither: values are those of neighbours"],
];

function kindColours(fit) {
  const out = new Uint8Array(3 * fit.n);
  fit.pixel.forEach((at, i) => KINDS.find(([is]) => is(fit.state[at]))[1].forEach((v, k) => (out[3 * i + k] = 255 * v)));
  return out;
}

function normalColours(normal, n) {
  return Uint8Array.from({ length: 3 * n }, (_, k) => Math.round(127.5 * (normal[(k % 3) * n + Math.floor(k / 3)] + 1)));
}

// Light that comes back, linear sRGB or grey three times, under a light of `strength` in each band.
function reflected(fit, reflectance, strength, seen) {
  const out = new Float32Array(3 * fit.n), all = strength.reduce((a, b) => a + b, 0) || 1;
  strength.forEach((s, b) => {
    const weight = seen === "camera" ? [s / all, s / all, s / all] : fit.daylight[b].map((w) => s * w);
    for (let i = 0, k = b * fit.n; i < fit.n; i++, k++) for (let c = 0; c < 3; c++) out[3 * i + c] += weight[c] * reflectance[k];
  });
  return out;
}

const eyeColours = (fit, reflectance) =>
  Uint8Array.from(reflected(fit, reflectance, fit.wavelength_nm.map(() => 1), "eye"), (v) => Math.round(255 * encode(v)));

function meanOver(values, n) {
  const out = new Float32Array(n), channels = values.length / n;
  values.forEach((v, k) => (out[k % n] += v / channels));
  return out;
}

// The ends of a map's colour scale: from 0 or the lowest percent to the highest.
function rangeOf(fit, map, values) {
  const sorted = values.filter((_, i) => fit.state[fit.pixel[i]] & map.bit).sort();
  if (!sorted.length) return [0, 1];
  const at = (share) => sorted[Math.round(share * (sorted.length - 1))];
  const low = map.zero ? 0 : at(0.01), high = at(0.99);
  return [low, high > low ? high : low + 1];
}

// Numbers of a map over the pixels for which it holds.
function summarise(fit, map, values) {
  const sorted = values.filter((_, i) => fit.state[fit.pixel[i]] & map.bit).sort(), unit = map.unit ?? "";
  if (!sorted.length) return "Nothing is known of it.";
  const mean = sorted.reduce((a, b) => a + b, 0) / sorted.length, at = (share) => say(sorted[Math.round(share * (sorted.length - 1))]) + unit;
  return `median ${at(0.5)}, mean ${say(mean) + unit}, 5 to 95 % from ${at(0.05)} to ${at(0.95)}, over ${sorted.length.toLocaleString("en")} pixels`;
}

// What a map is to be painted with: colours, or values with the ends of their scale.
async function prepare(fit, map, ends) {
  if (map.colours) return { colours: await map.colours() };
  const values = await map.values();
  return { values, ends: ends ?? rangeOf(fit, map, values) };
}

// Paint every `step`th pixel from column `left` on: fills the bytes of an image, transparent where the map does not hold.
function paint(image, fit, map, { colours, values, ends }, step = 1, left = 0) {
  const ramp = RAMPS[map.ramp], [low, high] = ends ?? [0, 1], data = image.data;
  for (let y = 0, k = 0; y < image.height; y++) {
    for (let x = 0; x < image.width; x++, k += 4) {
      if (x < left) continue;
      const at = y * step * fit.width + x * step, i = fit.place[at];
      if (i < 0 || !(fit.state[at] & map.bit)) data.set(NOTHING, k);
      else if (colours) data.set([colours[3 * i], colours[3 * i + 1], colours[3 * i + 2], 255], k);
      else {
        const t = Math.min(Math.max((values[i] - low) / (high - low), 0), 1), q = 3 * Math.round(255 * (map.flip ? 1 - t : t));
        data.set([ramp[q], ramp[q + 1], ramp[q + 2], 255], k);
      }
    }
  }
}
