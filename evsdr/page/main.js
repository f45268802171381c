// What ties the page together.
const byId = (id) => document.getElementById(id);
const radians = (degrees) => (degrees * Math.PI) / 180;

main().catch((error) => {
  byId("trouble").textContent = `This page can't show its pictures: ${error.message}. All words and numbers stand below.`;
  byId("trouble").hidden = false;
});

async function main() {
  if (typeof DecompressionStream === "undefined") throw new Error("the browser is too old to unpack them; use one of 2023 or later");
  const contents = JSON.parse(byId("evsdr-report").textContent);
  const fit = await openReport(contents, contents.title);
  const [normal, reflectance, points, ties] = [await fit.layer("normal"), await fit.layer("reflectance"), await surfacePoints(fit), await fit.layer("ties")];
  const view = { tab: "light", chosen: middleOf(fit), yaw: 0, pitch: 0, zoom: 1, scale: 1, middle: [0.5, 0.5] }, size = points && extent(fit, points);
  byId("frame").style.aspectRatio = `${fit.width} / ${fit.height}`;
  byId("frame").style.setProperty("--shape", String(fit.width / fit.height));
  byId("frame").classList.toggle("coarse", Math.max(fit.width, fit.height) < 128);
  [byId("flat").width, byId("flat").height] = [fit.width, fit.height];
  const relight = makeRelight(byId("lit"), fit, normal, points);
  const mesh = points && makeMesh(byId("solid"), fit, normal, points, ties);
  const maps = mapsOf(fit), strength = fit.wavelength_nm.map(() => 1);
  const compare = makeCompare(fit, byId, () => show());
  let ends = null;

  // ------------------------------------------------------------ light

  const light = () => {
    const [azimuth, elevation] = [radians(Number(byId("azimuth").value)), radians(Number(byId("elevation").value))];
    const direction = [Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)];
    const share = Number(byId("distance").value) / 100, near = size && share < 1;
    const reach = near ? size.radius * 1.3 * (8 / 1.3) ** share : 0;
    return { direction, near, reach, place: near ? direction.map((v, k) => size.middle[k] + reach * v) : direction, ambient: Number(byId("ambient").value), gain: 2 ** Number(byId("gain").value) };
  };
  const tint = () => {
    const colours = reflected(fit, reflectance, strength, byId("seen").value);
    relight?.paint(colours);
    return colours;
  };
  const showLight = () => {
    const now = light();
    byId("azimuth-said").textContent = `${byId("azimuth").value}°`;
    byId("height-said").textContent = `${byId("elevation").value}°`;
    byId("distance-said").textContent = now.near ? `${say(now.reach / size.radius, 2)} times the object's radius` : "far";
    byId("ambient-said").textContent = say(now.ambient, 2);
    byId("gain-said").textContent = `× ${say(now.gain, 2)}`;
    drawPad(byId("pad"), fit, now.direction);
    relight?.draw(now);
  };
  const aim = (x, y) => {
    const length = Math.hypot(x, y), scale = length > 1 ? 1 / length : 1;
    byId("azimuth").value = String(Math.round((Math.atan2(y, x) * 180) / Math.PI));
    byId("elevation").value = String(Math.round((Math.acos(Math.min(length * scale, 1)) * 180) / Math.PI));
    show();
  };
  const resetLight = () => {
    Object.entries({ azimuth: 135, elevation: 45, distance: 100, ambient: 0.08, gain: 0.3 }).forEach(([id, v]) => (byId(id).value = String(v)));
    byId("seen").value = "eye";
    setLamp("day");
  };
  const setLamp = (name) => {
    byId("lamp").value = name;
    strength.forEach((_, b) => (strength[b] = name === "day" || name === String(b) ? 1 : 0));
    sliders.forEach(([b, slider]) => (slider.value = String(strength[b])));
    tint();
    show();
  };
  const sliders = bandSliders(fit, strength, () => {
    byId("lamp").value = "own";
    tint();
    show();
  });

  // ------------------------------------------------------------ maps, shape, pixel

  const current = () => maps.find((map) => map.id === byId("map").value);
  const showMap = async () => {
    const map = current(), ready = await prepare(fit, map, ends), context = byId("flat").getContext("2d");
    const image = context.createImageData(fit.width, fit.height);
    paint(image, fit, map, ready);
    context.putImageData(image, 0, 0);
    byId("map-words").replaceChildren(map.words, ...(map.legend ?? []).map(legendEntry));
    byId("scale").hidden = !ready.ends;
    byId("map-numbers").textContent = ready.values ? summarise(fit, map, ready.values) : "";
    byId("unit").textContent = map.unit ?? "";
    if (!ready.ends) return;
    [byId("low").value, byId("high").value] = ready.ends.map((v) => String(Number(v.toPrecision(3))));
    drawRamp(byId("ramp"), map);
  };
  const skin = () => {
    const kind = byId("skin").value, colours = tint();
    if (!mesh) return;
    if (kind === "clay") mesh.tint(new Float32Array(3 * fit.n).fill(0.45));
    else if (kind === "normal") mesh.tint(Float32Array.from(normalColours(normal, fit.n), (v) => decodeByte(v)));
    else mesh.tint(colours);
  };
  const showShape = () => {
    view.relief = Number(byId("relief").value);
    [view.yaw, view.pitch] = [radians(Number(byId("yaw").value)), radians(Number(byId("pitch").value))];
    byId("yaw-said").textContent = `${byId("yaw").value}°`;
    byId("pitch-said").textContent = `${byId("pitch").value}°`;
    byId("relief-said").textContent = `× ${say(view.relief, 2)}`;
    mesh?.draw({ ...view, lit: ["lit", "clay"].includes(byId("skin").value) }, { ...light(), ambient: Math.max(light().ambient, 0.08) });
  };
  const turn = (yaw, pitch) => {
    byId("yaw").value = String(((Number(byId("yaw").value) + yaw + 540) % 360) - 180);
    byId("pitch").value = String(Math.min(Math.max(Number(byId("pitch").value) + pitch, -90), 90));
    show();
  };
  const choose = (x, y) => {
    view.chosen = { x: Math.min(Math.max(x, 0), fit.width - 1), y: Math.min(Math.max(y, 0), fit.height - 1) };
    [byId("column").value, byId("row").value] = [String(view.chosen.x), String(view.chosen.y)];
    show();
    return showPixel(fit, view.chosen.x, view.chosen.y);
  };

  // ------------------------------------------------------------ all of it

  const show = () => {
    if (view.tab === "light") showLight();
    else if (view.tab === "shape") showShape();
    else if (view.tab === "compare") compare.draw(byId("flat"));
    else showMap();
    const split = view.tab === "compare" ? compare.split : null;
    const frame = framing(view.scale, view.middle);
    for (const id of ["lit", "flat"]) byId(id).style.transform = `translate(${100 * frame.left}%, ${100 * frame.top}%) scale(${frame.scale})`;
    drawMarks(byId("marks"), fit, { frame, chosen: view.chosen, hatch: byId("hatch").checked && view.tab !== "shape", split, bare: view.tab === "shape" });
  };
  const tabs = makeTabs(byId, (name) => {
    view.tab = name;
    if (name === "shape") skin();
    show();
  });
  byId("map").replaceChildren(...maps.map((map) => new Option(map.name, map.id)));
  byId("lamp").replaceChildren(new Option("daylight (all bands)", "day"), ...sliders.map(([b]) => new Option(`${fit.wavelength_nm[b].toFixed(0)} nm alone`, String(b))), new Option("my own", "own"));
  for (const id of ["azimuth", "elevation", "distance", "ambient", "gain", "yaw", "pitch", "relief"]) byId(id).addEventListener("input", show);
  byId("seen").addEventListener("change", () => { tint(); show(); });
  byId("lamp").addEventListener("change", (event) => event.target.value !== "own" && setLamp(event.target.value));
  byId("skin").addEventListener("change", () => { skin(); show(); });
  byId("hatch").addEventListener("change", show);
  byId("map").addEventListener("change", () => { ends = null; show(); });
  for (const id of ["low", "high"]) byId(id).addEventListener("change", () => { ends = [Number(byId("low").value), Number(byId("high").value)]; show(); });
  for (const [id, factor] of [["nearer", 1.5], ["farther", 1 / 1.5]]) byId(id).addEventListener("click", () => enlarge(factor));
  byId("reset-scale").addEventListener("click", () => { ends = null; show(); });
  byId("reset-light").addEventListener("click", resetLight);
  byId("reset-shape").addEventListener("click", () => { [byId("yaw").value, byId("pitch").value, byId("relief").value, view.zoom] = ["0", "0", "1", 1]; show(); });
  byId("where").addEventListener("input", () => choose(Number(byId("column").value), Number(byId("row").value)));
  byId("where").addEventListener("submit", (event) => event.preventDefault());
  [byId("column").max, byId("row").max] = [String(fit.width - 1), String(fit.height - 1)];
  const ratio = fit.width / fit.height;
  const inside = (x, y) => {
    const { scale, left, top } = framing(view.scale, view.middle);
    return [(x - left) / scale, (y - top) / scale];
  };
  const pick = (x, y) => choose(...inside(x, y).map((v, k) => Math.floor(v * [fit.width, fit.height][k])));
  const enlarge = (factor) => {
    if (view.tab === "shape") view.zoom = Math.min(Math.max(view.zoom * factor, 0.5), 20);
    else {
      if (view.scale === 1) view.middle = [(view.chosen.x + 0.5) / fit.width, (view.chosen.y + 0.5) / fit.height];
      view.scale = Math.min(Math.max(view.scale * factor, 1), 32);
    }
    show();
  };
  watch(byId("frame"), {
    click: (x, y) => view.tab !== "shape" && pick(x, y),
    drag: (x, y, dx, dy) => {
      if (view.tab === "maps" && view.scale > 1) {
        const { scale, left, top } = framing(view.scale, view.middle);
        view.middle = [(0.5 - left - dx) / scale, (0.5 - top - dy) / scale];
        show();
      } else if (view.tab === "light") aim((2 * x - 1) * Math.max(ratio, 1), (1 - 2 * y) * Math.max(1 / ratio, 1));
      else if (view.tab === "shape") turn(200 * dx, 200 * dy);
      else if (view.tab === "compare") { byId("split").value = String(100 * Math.min(Math.max(inside(x, y)[0], 0), 1)); show(); }
      else pick(x, y);
    },
    zoom: enlarge,
    free: () => view.tab === "shape",
  });
  watch(byId("pad"), { click: (x, y) => aim(2.2 * x - 1.1, 1.1 - 2.2 * y), drag: (x, y) => aim(2.2 * x - 1.1, 1.1 - 2.2 * y) });
  const arrows = (event, act) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!step) return false;
    event.preventDefault();
    act(...step.map((v) => v * (event.shiftKey ? 10 : 1)));
    return true;
  };
  const nudge = (x, y) => { const [a, b] = light().direction; aim(a + 0.05 * x, b + 0.05 * y); };
  byId("pad").addEventListener("keydown", (event) => arrows(event, nudge));
  byId("frame").addEventListener("keydown", (event) => {
    const acts = { light: nudge, shape: (x, y) => turn(5 * x, -5 * y) };
    if (arrows(event, acts[view.tab] ?? ((x, y) => choose(view.chosen.x + x, view.chosen.y - y)))) return;
    if ("+-".includes(event.key)) enlarge(event.key === "+" ? 1.25 : 0.8);
  });
  new ResizeObserver(() => show()).observe(byId("frame"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => show());
  if (!relight) {
    byId("trouble").textContent = "The browser has no WebGL2: the lamp and the turning surface are missing, all maps are there.";
    byId("trouble").hidden = false;
  }
  byId("shape-words").textContent = mesh ? byId("shape-words").textContent : "There is no depth to show.";
  byId("distance").disabled = !size;
  fit.brightest = brightest(fit, reflectance);
  byId("held").textContent = held(fit);
  resetLight();
  tabs(relight ? "light" : "maps");
  await choose(view.chosen.x, view.chosen.y);
  await sheet(fit, maps, (map) => {
    byId("map").value = map.id;
    ends = null;
    tabs("maps");
    byId("stage").scrollIntoView({ behavior: "smooth", block: "center" });
  });
  window.evsdr = {
    fit, maps, mesh, choose, valuesOf: (x, y) => valuesOf(fit, x, y), show: tabs, open: (file) => compare.open(file),
    relight: (given) => { relight.draw({ ...light(), ...given }); return relight.read(); },
    under: (strengths, seen) => relight.paint(reflected(fit, reflectance, strengths, seen)),
  };
  document.documentElement.dataset.ready = "yes";
}

const decodeByte = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);

// The known pixel that is nearest to the middle of all known ones.
function middleOf(fit) {
  const known = fit.pixel.filter((at) => fit.state[at] & KNOWN), all = known.length ? known : fit.pixel, w = fit.width;
  if (!all.length) return { x: w >> 1, y: fit.height >> 1 };
  const [x, y] = all.reduce(([a, b], at) => [a + (at % w) / all.length, b + Math.floor(at / w) / all.length], [0, 0]);
  const far = (at) => ((at % w) - x) ** 2 + (Math.floor(at / w) - y) ** 2, best = all.reduce((a, b) => (far(b) < far(a) ? b : a));
  return { x: best % w, y: Math.floor(best / w) };
}

// A slider for each band, in order of wavelength; gives [band, slider].
function bandSliders(fit, strength, changed) {
  const order = fit.wavelength_nm.map((_, b) => b).sort((a, b) => fit.wavelength_nm[a] - fit.wavelength_nm[b]);
  return order.map((b) => {
    const label = byId("bands").appendChild(document.createElement("label")), slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: "0", max: "2", step: "0.05", value: "1" });
    slider.style.accentColor = css(fit.band_colour[b]);
    slider.addEventListener("input", () => { strength[b] = Number(slider.value); changed(); });
    label.append(`${fit.wavelength_nm[b].toFixed(0)} nm`, slider);
    return [b, slider];
  });
}
