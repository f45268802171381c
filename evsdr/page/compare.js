// Two fits beside each other.
function makeCompare(fit, byId, changed) {
  let other = null, round = 0;
  const shared = () => {
    const theirs = new Map(mapsOf(other).map((map) => [map.id, map]));
    return mapsOf(fit).filter((map) => theirs.has(map.id)).map((map) => [map, theirs.get(map.id)]);
  };
  const open = async (file) => {
    try {
      const opened = await openOther(file);
      if (opened.width !== fit.width || opened.height !== fit.height) throw new Error(`it has ${opened.width} × ${opened.height} pixels, this page ${fit.width} × ${fit.height}`);
      other = { ...opened, daylight: opened.daylight ?? (sameBands(fit, opened) ? fit.daylight : null) };
    } catch (error) {
      byId("other-name").textContent = `${file.name} can't be compared: ${error.message}.`;
      return;
    }
    byId("other-name").textContent = `Left: this page. Right: ${other.name}.`;
    byId("compared").replaceChildren(...shared().map(([map]) => new Option(map.name, map.id)));
    byId("comparing").hidden = false;
    byId("compare-numbers").textContent = await differences(fit, other);
    changed();
  };
  byId("other").addEventListener("change", (event) => event.target.files[0] && open(event.target.files[0]));
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files[0]) open(event.dataTransfer.files[0]).then(() => byId("tab-compare").click());
  });
  for (const id of ["compared", "way"]) byId(id).addEventListener("change", changed);
  byId("split").addEventListener("input", changed);

  // Paint the comparison on a canvas; without another fit, the first map of this one.
  const draw = async (canvas) => {
    const mine = ++round, split = Number(byId("split").value) / 100;
    byId("split-said").textContent = `${Math.round(100 * split)} %`;
    const context = canvas.getContext("2d"), image = context.createImageData(fit.width, fit.height);
    const [map, theirs] = other ? shared().find(([map]) => map.id === byId("compared").value) : [mapsOf(fit)[0], null];
    let ready = await prepare(fit, map), unit = map.unit ?? "";
    if (other && byId("way").value === "difference") {
      const { both, shown, away } = await difference(fit, other, map, theirs);
      paint(image, both, shown, away);
      [ready, unit] = [away, shown.unit ?? ""];
    } else {
      paint(image, fit, map, ready);
      if (other) paint(image, other, theirs, await prepare(other, theirs, ready.ends), 1, Math.round(split * fit.width));
    }
    if (mine !== round) return;
    context.putImageData(image, 0, 0);
    byId("compare-scale").textContent = ready.ends ? `Colours from ${say(ready.ends[0])}${unit} (dark) to ${say(ready.ends[1])}${unit} (bright).` : "";
  };
  return { draw, get split() { return other && byId("way").value === "side" ? Number(byId("split").value) / 100 : null; } };
}

const sameBands = (a, b) => a.wavelength_nm.length === b.wavelength_nm.length && a.wavelength_nm.every((nm, k) => Math.abs(nm - b.wavelength_nm[k]) < 0.5);

// The number of each stored pixel of one fit in another, -1 where one of them has no known value.
function matched(fit, other, bit) {
  return fit.pixel.map((at) => (fit.state[at] & bit && other.state[at] & bit ? other.place[at] : -1));
}

function angles(fit, other, ours, theirs, to) {
  const out = new Float32Array(fit.n), [n, m] = [fit.n, other.n];
  to.forEach((j, i) => {
    if (j < 0) return;
    const sum = [0, 0];
    for (let k = 0; k < 3; k++) {
      sum[0] += (ours[k * n + i] - theirs[k * m + j]) ** 2;
      sum[1] += (ours[k * n + i] + theirs[k * m + j]) ** 2;
    }
    out[i] = (360 / Math.PI) * Math.atan2(Math.sqrt(sum[0]), Math.sqrt(sum[1]));
  });
  return out;
}

// A map of differences where both are known: angles of normals, absolute differences of values, distance of colours.
async function difference(fit, other, map, theirs) {
  const to = matched(fit, other, map.bit);
  let values;
  if (map.id === "normal") values = angles(fit, other, await fit.layer("normal"), await other.layer("normal"), to);
  else if (map.colours) {
    const [a, b] = [await map.colours(), await theirs.colours()];
    values = Float32Array.from(to, (j, i) => (j < 0 ? 0 : Math.hypot(...[0, 1, 2].map((k) => (a[3 * i + k] - b[3 * j + k]) / 255))));
  } else {
    const [a, b] = [await map.values(), await theirs.values()];
    values = Float32Array.from(to, (j, i) => (j < 0 ? 0 : Math.abs(a[i] - b[j])));
  }
  const both = { ...fit, state: fit.state.map((bits, at) => (other.state[at] & map.bit ? bits : 0)) };
  const shown = { ...map, colours: null, ramp: "heat", zero: true, flip: false, unit: map.id === "normal" ? "°" : map.unit };
  return { both, shown, away: { values, ends: rangeOf(both, shown, values) } };
}

async function differences(fit, other) {
  const to = matched(fit, other, KNOWN), away = angles(fit, other, await fit.layer("normal"), await other.layer("normal"), to);
  const both = away.filter((_, i) => to[i] >= 0).sort();
  if (!both.length) return "No pixel is known in both.";
  const out = [`Over ${both.length.toLocaleString("en")} pixels known in both: normals differ by ${say(both.reduce((a, b) => a + b, 0) / both.length, 3)}° on average, ${say(both[Math.floor(both.length / 2)], 3)}° in the median`];
  if (sameBands(fit, other)) {
    const [a, b] = [await fit.layer("reflectance"), await other.layer("reflectance")];
    const square = fit.wavelength_nm.map((_, c) => to.reduce((s, j, i) => (j < 0 ? s : s + (a[c * fit.n + i] - b[c * other.n + j]) ** 2), 0));
    out.push(`reflectances by ${say(Math.sqrt(square.reduce((x, y) => x + y, 0) / square.length / both.length), 3)}, root mean square`);
  } else out.push("their bands differ");
  return `${out.join("; ")}.`;
}
