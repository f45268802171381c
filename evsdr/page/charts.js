// Charts as SVG.
function svg(name, attributes = {}, parent = null, text = "") {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = text;
  parent?.append(element);
  return element;
}

// Axes of a chart; gives the picture and where values lie in it.
function axes({ label, x, y, across, up, names, ticks, size = [520, 260] }) {
  const [width, height] = size, box = { left: 60, right: width - 12, top: 12, bottom: height - 40 };
  const chart = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label, class: "chart" });
  const at = (v) => box.left + ((v - x[0]) / (x[1] - x[0])) * (box.right - box.left);
  const over = (v) => box.bottom - ((v - y[0]) / (y[1] - y[0])) * (box.bottom - box.top);
  const step = niceStep(y[1] - y[0]);
  for (let v = Math.ceil(y[0] / step) * step; v <= y[1] + 1e-9; v += step) {
    svg("line", { x1: box.left, x2: box.right, y1: over(v), y2: over(v), class: "grid" }, chart);
    svg("text", { x: box.left - 7, y: over(v) + 4, class: "tick end" }, chart, say(v, 3));
  }
  ticks.forEach((v, k) => svg("text", { x: at(v), y: box.bottom + 17, class: "tick middle" }, chart, names[k]));
  svg("text", { x: (box.left + box.right) / 2, y: height - 5, class: "tick middle" }, chart, across);
  svg("text", { x: 13, y: (box.top + box.bottom) / 2, class: "tick middle", transform: `rotate(-90 13 ${(box.top + box.bottom) / 2})` }, chart, up);
  return { chart, at, over, box };
}

function niceStep(span) {
  const rough = span / 4, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((m) => m * power >= rough);
}

// A bar from low to high, kept to the chart.
function whisker({ chart, over, box }, x, low, high, kind) {
  const [y1, y2] = [low, high].map((v) => Math.min(Math.max(over(v), box.top), box.bottom));
  svg("line", { x1: x, x2: x, y1, y2, class: kind }, chart);
}

// Spectrum: bands with wavelength, value, sigma (or null) and colour, in order of wavelength.
function spectrumChart(bands, highest) {
  const nm = bands.map((b) => b.nm), wide = Math.max(nm.at(-1) - nm[0], 20) * 0.06;
  const top = Math.max(highest, ...bands.map((b) => 1.04 * (b.value + (b.sigma ?? 0)))), shown = spaced(nm, (26 * (nm.at(-1) - nm[0] + 2 * wide)) / 456);
  const drawn = axes({
    label: `Reflectance over wavelength: ${bands.map((b) => `${b.nm.toFixed(0)} nm ${say(b.value)}`).join(", ")}`,
    x: [nm[0] - wide, nm.at(-1) + wide], y: [0, Math.min(top, 5)], across: "wavelength [nm]", up: "reflectance", ticks: shown, names: shown.map((v) => v.toFixed(0)),
  });
  const { chart, at, over } = drawn, line = (key) => bands.map((b) => `${at(b.nm)},${over(b[key])}`).join(" ");
  svg("polyline", { points: line("value"), class: "curve" }, chart);
  for (const b of bands) {
    if (b.sigma !== null) {
      whisker(drawn, at(b.nm), b.value - 2 * b.sigma, b.value + 2 * b.sigma, "thin");
      whisker(drawn, at(b.nm), b.value - b.sigma, b.value + b.sigma, "thick");
    }
    svg("circle", { cx: at(b.nm), cy: Math.max(over(b.value), drawn.box.top), r: 5, fill: b.colour, class: "dot" }, chart);
  }
  return chart;
}

// Numbers at least so far apart.
function spaced(values, least) {
  return values.reduce((kept, v) => (kept.length && v - kept.at(-1) < least ? kept : [...kept, v]), []);
}

const UNTOLD = 0.5; // of log light: a signal known worse than that is hollow

// Light of each LED: modelled, measured, sigma of its logarithm, colour.
function signalChart(leds, constantLight) {
  const told = leds.filter((l) => l.sigma < UNTOLD);
  const top = 1.08 * Math.max(...leds.map((l) => l.modelled), ...told.map((l) => Math.min(l.measured * Math.exp(l.sigma), 2 * Math.max(l.modelled, constantLight))));
  const every = leds.length > 32 ? 8 : leds.length > 12 ? 3 : 1, ticks = leds.map((_, j) => j).filter((j) => j % every === 0);
  const drawn = axes({
    label: `Light of ${leds.length} LEDs, modelled and measured; the table below has the numbers`,
    x: [-0.7, leds.length - 0.3], y: [0, top || 1], across: "LED", up: "light", ticks, names: ticks.map(String),
  });
  const { chart, at, over, box } = drawn, half = (0.42 * (box.right - box.left)) / leds.length;
  svg("line", { x1: box.left, x2: box.right, y1: over(constantLight), y2: over(constantLight), class: "veil" }, chart);
  leds.forEach((l, j) => {
    svg("rect", { x: at(j) - half, width: 2 * half, y: over(l.modelled), height: Math.max(box.bottom - over(l.modelled), 0), fill: l.colour, class: "bar" }, chart);
    svg("line", { x1: at(j) - half, x2: at(j) + half, y1: over(l.modelled), y2: over(l.modelled), class: "step" }, chart);
    if (l.sigma < UNTOLD) whisker(drawn, at(j), l.measured * Math.exp(-l.sigma), l.measured * Math.exp(l.sigma), "thick");
    svg("circle", { cx: at(j), cy: Math.min(Math.max(over(l.measured), box.top), box.bottom), r: Math.min(4, half), fill: l.colour, class: l.sigma < UNTOLD ? "dot" : "hollow" }, chart);
  });
  return chart;
}
