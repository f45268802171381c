// All maps as small pictures, their legends, and what the page holds.
function legendEntry([, colour, words]) {
  const entry = document.createElement("span"), patch = entry.appendChild(document.createElement("i"));
  entry.className = "legend";
  patch.style.background = css(colour);
  entry.append(words);
  return entry;
}

function drawRamp(canvas, map) {
  const context = canvas.getContext("2d"), image = context.createImageData(canvas.width, canvas.height), ramp = RAMPS[map.ramp];
  for (let y = 0; y < canvas.height; y++)
    for (let x = 0; x < 256; x++) {
      const q = 3 * (map.flip ? 255 - x : x);
      image.data.set([ramp[q], ramp[q + 1], ramp[q + 2], 255], 4 * (y * canvas.width + x));
    }
  context.putImageData(image, 0, 0);
}

const THUMB = 320; // pixels of a picture among all maps, at most

// A small picture of each map, which opens it in the viewer.
async function sheet(fit, maps, open) {
  const step = Math.max(1, Math.ceil(Math.max(fit.width, fit.height) / THUMB));
  for (const map of maps.filter((map) => !map.aside)) {
    const figure = document.createElement("figure"), button = figure.appendChild(document.createElement("button"));
    const canvas = button.appendChild(document.createElement("canvas")), ready = await prepare(fit, map);
    [canvas.width, canvas.height] = [Math.ceil(fit.width / step), Math.ceil(fit.height / step)];
    canvas.className = Math.max(fit.width, fit.height) < 128 ? "coarse" : "";
    const context = canvas.getContext("2d"), image = context.createImageData(canvas.width, canvas.height);
    paint(image, fit, map, ready, step);
    context.putImageData(image, 0, 0);
    button.title = `Show ${map.name} in the viewer`;
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", () => open(map));
    const caption = figure.appendChild(document.createElement("figcaption"));
    caption.append(map.name);
    if (ready.ends) {
      const scale = figure.appendChild(document.createElement("div")), ramp = document.createElement("canvas");
      Object.assign(ramp, { width: 256, height: 6 });
      scale.className = "mini";
      drawRamp(ramp, map);
      scale.append(say(ready.ends[0], 2), ramp, say(ready.ends[1], 2) + (map.unit ?? ""));
    }
    for (const entry of map.legend ?? []) figure.append(legendEntry(entry));
    byId("sheet").append(figure);
  }
}

// Where the axis of all spectra ends, so that pixels can be compared.
function brightest(fit, reflectance) {
  const some = reflectance.filter((_, k) => fit.state[fit.pixel[k % fit.n]] & KNOWN).sort();
  return Math.ceil(10.5 * (some[Math.floor(0.995 * some.length)] ?? 1)) / 10;
}

// What the page holds, and how exactly.
function held(fit) {
  const names = Object.entries(fit.layers).filter(([name]) => !["state", "ties"].includes(name)).map(([name, layer]) => {
    const half = (layer.high - layer.low) / (2 ** layer.bits - 1) / 2;
    const exact = layer.scale === "linear" && half === 0.5;
    return `${name.replaceAll("_", " ")} (${exact ? "exact" : `to ${layer.scale === "linear" ? say(half, 1) : `${say(100 * half, 1)} %${layer.scale === "asinh" ? ", or nearer 0" : ""}`}`})`;
  });
  const out = `Arrays of ${fit.n.toLocaleString("en")} pixels: ${names.join(", ")}. Exact values are in maps.npz.`;
  return fit.left_out.length ? `${out} Left out, to keep the page small: ${fit.left_out.map((name) => name.replaceAll("_", " ")).join(", ")}.` : out;
}
