// One pixel: what it is in words, charts and numbers.
function cells(kind, texts, parent) {
  const row = parent.appendChild(document.createElement("tr"));
  texts.forEach((text, k) => {
    const cell = row.appendChild(document.createElement(k && kind === "td" ? "td" : "th"));
    cell.scope = kind === "th" ? "col" : "row";
    if (k && kind === "td") cell.removeAttribute("scope");
    cell.textContent = text;
  });
}

function tableOf(head, rows) {
  const table = document.createElement("table");
  cells("th", head, table.createTHead());
  const body = table.createTBody();
  rows.forEach((texts) => cells("td", texts, body));
  return table;
}

// All values of a pixel; null for what the fit does not hold.
async function valuesOf(fit, x, y) {
  const at = y * fit.width + x, i = fit.place[at], bits = fit.state[at];
  if (i < 0) return { x, y, bits };
  const get = async (key) => {
    const all = await fit.layer(key);
    return all && Array.from({ length: all.length / fit.n }, (_, c) => all[c * fit.n + i]);
  };
  const one = async (key, bit) => (bits & bit ? (await get(key))?.[0] : null) ?? null;
  return {
    x, y, bits, normal: await get("normal"), reflectance: await get("reflectance"), reflectance_sigma: await get("reflectance_sigma"),
    normal_sigma_deg: await one("normal_sigma_deg", KNOWN), depth: await one("depth", DEEP), residual: await one("residual", SOLVED), events: await one("events", SOLVED),
    angle_deg: await one("angle_deg", TRUE), rmse: await one("rmse", TRUE), light: await get("light"), change: await get("change"), change_sigma: await get("change_sigma"),
  };
}

function inWords(v) {
  if (!(v.bits & SOLVED)) return `Column ${v.x}, row ${v.y}: outside the object.`;
  const [nx, ny, nz] = v.normal, tilt = (Math.acos(Math.min(nz, 1)) * 180) / Math.PI, toward = (Math.atan2(ny, nx) * 180) / Math.PI;
  const out = [`Column ${v.x}, row ${v.y}: normal (${say(nx)}, ${say(ny)}, ${say(nz)}), ${tilt < 0.5 ? "facing the camera" : `tilted ${say(tilt)}° toward ${WINDS[(Math.round(toward / 45) + 8) % 8]}`}`];
  if (v.bits & KNOWN) out[0] += v.normal_sigma_deg === null ? "." : `, 1 σ ${say(v.normal_sigma_deg, 2)}°.`;
  else out[0] += "; nothing is known here, values are those of neighbours.";
  if (v.bits & KNOWN && !(v.bits & SCALED)) out.push("How bright it is is not known, only its colour.");
  if (v.depth !== null) out.push(`Depth ${say(v.depth, 4)} in the scene's unit.`);
  if (v.events !== null) out.push(`${v.events} pairs of events${v.events ? `, which leave ${say(100 * v.residual, 2)} % of a threshold unexplained` : ""}.`);
  if (v.angle_deg !== null) out.push(`Off the truth by ${say(v.angle_deg, 2)}°${v.rmse === null ? "" : ` and ${say(v.rmse, 2)} in reflectance`}.`);
  return out.join(" ");
}

const WINDS = ["the right", "the upper right", "the top", "the upper left", "the left", "the lower left", "the bottom", "the lower right"];

async function showPixel(fit, x, y) {
  const v = await valuesOf(fit, x, y), place = (id, ...parts) => document.getElementById(id).replaceChildren(...parts);
  document.getElementById("pixel-words").textContent = inWords(v);
  const nm = fit.wavelength_nm, order = nm.map((_, b) => b).sort((a, b) => nm[a] - nm[b]);
  const colour = (b) => css(fit.band_colour[b]), lit = v.light && fit.leds;
  document.getElementById("signals-figure").hidden = !fit.has("light");
  if (!(v.bits & SOLVED)) return ["spectrum", "signals", "pixel-table"].forEach((id) => place(id));
  const bands = order.map((b) => ({ nm: nm[b], value: v.reflectance[b], sigma: v.bits & KNOWN ? v.reflectance_sigma?.[b] ?? null : null, colour: colour(b) }));
  place("spectrum", spectrumChart(bands, fit.brightest));
  const tables = [tableOf(["band [nm]", "reflectance", "1 σ"], bands.map((b) => [b.nm.toFixed(1), say(b.value, 4), b.sigma === null ? "not known" : say(b.sigma, 2)]))];
  if (lit) {
    const leds = fit.leds.band.map((b, j) => ({ modelled: v.light[j], measured: v.light[j] * Math.exp(v.change[j]), sigma: v.change_sigma[j], colour: colour(b), nm: nm[b] }));
    place("signals", signalChart(leds, fit.leds.constant_light));
    tables.push(tableOf(["LED", "band [nm]", "modelled", "measured", "1 σ"], leds.map((l, j) => [String(j), l.nm.toFixed(0), say(l.modelled, 4), say(l.measured, 4), l.sigma < UNTOLD ? say(l.measured * l.sigma, 2) : "no events tell"])));
  }
  place("pixel-table", ...tables);
}
