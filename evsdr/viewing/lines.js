// Charts of a recording, as SVG.
const points = (list, { at, over }) => list.map(([x, y]) => `${at(x).toFixed(1)},${over(y).toFixed(1)}`).join(" ");
const span = (list, margin = 0.06) => {
  const [low, high] = [Math.min(...list), Math.max(...list)], more = margin * (high - low) || 1;
  return [low - more, high + more];
};
// Round numbers from 0 to the end.
function roundTicks([low, high]) {
  const step = niceStep(high - low), out = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9; v += step) out.push(Math.abs(v) < 1e-9 * step ? 0 : v);
  return out;
}
const axesOf = (given) => {
  const ticks = given.ticks ?? roundTicks(given.x);
  return axes({ ...given, ticks, names: given.names ?? ticks.map((v) => say(v, 4)) });
};

// ON events above, OFF events below.
function rateChart({ step_s: step, on, off }) {
  const top = Math.max(...on), low = Math.max(...off), unit = top + low > 2e6 ? [1e6, "million"] : top + low > 2e3 ? [1e3, "thousand"] : [1, ""];
  const drawn = axesOf({ label: `Events a second: up to ${say(top)} brighter and ${say(low)} darker ones`, x: [0, on.length * step], y: [-1.05 * low / unit[0], 1.05 * top / unit[0]], across: "time [s]", up: `events a second${unit[1] ? ` [${unit[1]}]` : ""}` });
  for (const [values, sign, kind] of [[on, 1, "on"], [off, -1, "off"]]) {
    const list = values.flatMap((v, k) => [[k * step, (sign * v) / unit[0]], [(k + 1) * step, (sign * v) / unit[0]]]);
    svg("polygon", { points: points([[0, 0], ...list, [values.length * step, 0]], drawn), class: `area ${kind}` }, drawn.chart);
  }
  return drawn.chart;
}

// Events of each slot; `chosen` is marked, `choose` is told of clicks.
function slotChart({ order, on, off }, chosen, choose) {
  const n = order.length, most = 1.05 * Math.max(...on.map((v, k) => v + off[k]), 1), unit = most > 9999 ? 1000 : 1, ticks = slotTicks(order);
  const drawn = axesOf({ label: `Events of ${n} slots; the table below has the numbers`, x: [-0.5, n - 0.5], y: [0, most / unit], across: "LED of the slot, which fades into the next", up: unit > 1 ? "events [thousand]" : "events", ticks, names: ticks.map((k) => ledName(order[k])) });
  const { chart, at, box } = drawn, over = (v) => drawn.over(v / unit), half = (0.4 * (box.right - box.left)) / n;
  order.forEach((led, k) => {
    const wide = { x: at(k - 0.5), width: at(k + 0.5) - at(k - 0.5), y: box.top, height: box.bottom - box.top };
    const field = svg("rect", { ...wide, class: "slot" }, chart);
    svg("title", {}, field, `slot ${k}, ${led < 0 ? "dark" : `LED ${led}`}: ${on[k]} brighter, ${off[k]} darker`);
    field.addEventListener("click", () => choose(k));
    if (k === chosen) svg("rect", { ...wide, class: "chosen" }, chart);
    svg("rect", { x: at(k) - half, width: 2 * half, y: over(on[k]), height: box.bottom - over(on[k]), class: "bars on" }, chart);
    svg("rect", { x: at(k) - half, width: 2 * half, y: over(on[k] + off[k]), height: over(on[k]) - over(on[k] + off[k]), class: "bars off" }, chart);
  });
  return chart;
}
const ledName = (led) => (led < 0 ? "dark" : String(led));
const slotTicks = (order) => {
  const every = order.length > 64 ? 8 : order.length > 28 ? 4 : order.length > 12 ? 2 : 1;
  return order.map((_, k) => k).filter((k) => k % every === 0);
};

function triggerChart({ index, deviation_us: deviation, missing }) {
  const far = Math.max(1, ...deviation.map(Math.abs)), last = Math.max(index.at(-1), 1);
  const drawn = axesOf({ label: `${index.length} triggers, within ${say(far)} us of an even grid; ${missing.length} missing`, x: [-0.02 * last, 1.02 * last], y: [-1.3 * far, 1.3 * far], across: "round", up: "off the grid [µs]", ticks: wholeTicks(last), names: wholeTicks(last).map((k) => String(k + 1)) });
  const { chart, at, over, box } = drawn, r = Math.min(4, Math.max(1.2, 150 / index.length));
  svg("line", { x1: box.left, x2: box.right, y1: over(0), y2: over(0), class: "zero" }, chart);
  index.forEach((k, i) => svg("circle", { cx: at(k), cy: over(deviation[i]), r, class: "point" }, chart));
  missing.forEach((k) => svg("path", { d: `M${at(k) - 5} ${over(0) - 5}l10 10m0 -10l-10 10`, class: "bad" }, chart));
  return chart;
}
const wholeTicks = (last) => {
  const step = Math.max(1, Math.ceil(last / 12));
  return Array.from({ length: Math.floor(last / step) + 1 }, (_, k) => k * step);
};

function beatChart({ hz, power, against }) {
  const top = Math.max(...power) * 1.08 || 1, drawn = axesOf({ label: `How far events keep time with each frequency; most with ${say(hz[power.indexOf(Math.max(...power))] ?? 0)} Hz`, x: [0, 400], y: [0, against ? Math.max(top, 1.05) : top], across: "frequency [Hz]", up: "in time", ticks: [0, 50, 100, 120, 200, 300, 400], names: ["0", "50", "100", "", "200", "300", "400"] });
  const { chart, at, box } = drawn;
  for (const mains of [100, 120]) {
    svg("line", { x1: at(mains), x2: at(mains), y1: box.top, y2: box.bottom, class: "mark" }, chart);
    svg("text", { x: at(mains) + (mains > 100 ? 4 : -4), y: box.top + 11, class: mains > 100 ? "tick" : "tick end" }, chart, `${mains} Hz`);
  }
  svg("polyline", { points: points(hz.map((f, k) => [f, power[k]]), drawn), class: "line" }, chart);
  return chart;
}

function shiftChart({ shift, coherence }) {
  const drawn = axesOf({ label: "How far the events of a slot agree in polarity, over a shift of the slots", x: [shift[0], shift.at(-1)], y: [Math.max(0, Math.min(...coherence, 0.9) - 0.02), 1.005], across: "shift of the start [slots]", up: "agree" });
  const { chart, at, box } = drawn;
  svg("line", { x1: at(0), x2: at(0), y1: box.top, y2: box.bottom, class: "mark" }, chart);
  svg("polyline", { points: points(shift.map((s, k) => [s, coherence[k]]), drawn), class: "line" }, chart);
  return chart;
}

// Small triangles for events.
function triangles(list, { chart, at, over }, r) {
  for (const [kind, sign] of [["on", 1], ["off", -1]]) {
    const shapes = list.filter((e) => e.up === (sign > 0)).map((e) => `M${at(e.x).toFixed(1)} ${(over(e.y) - sign * r).toFixed(1)}l${r} ${sign * 1.8 * r}h${-2 * r}z`);
    if (shapes.length) svg("path", { d: shapes.join(""), class: `event ${kind}` }, chart);
  }
}

// The events of a pixel in a round, beside what is modelled.
function foldedChart(view, folded, curve, words) {
  const { order } = view.schedule, ticks = slotTicks(order);
  const shift = curve.length && folded.events.length ? middle(folded.events.map((e) => e.level - at(curve, e.at))) : 0;
  const shown = curve.map(([s, v]) => [s, v + shift]), y = span([...shown.map(([, v]) => v), ...folded.events.map((e) => e.level)]);
  const drawn = axesOf({ label: `${folded.events.length} events over a round of ${order.length} slots, beside ${words}`, x: [0, order.length], y: Number.isFinite(y[0]) ? y : [-1, 1], across: "LED that is fully lit", up: "log light", ticks, names: ticks.map((k) => ledName(order[k])), size: [720, 300] });
  for (const k of ticks) svg("line", { x1: drawn.at(k), x2: drawn.at(k), y1: drawn.box.top, y2: drawn.box.bottom, class: "grid" }, drawn.chart);
  triangles(folded.events.map((e) => ({ x: e.at, y: e.level, up: e.up })), drawn, folded.events.length > 1500 ? 2.4 : 4);
  svg("polyline", { points: points(shown, drawn), class: "model" }, drawn.chart);
  return drawn.chart;
}
const middle = (list) => [...list].sort((a, b) => a - b)[list.length >> 1];
// A curve [x, y] at a place.
function at(curve, x) {
  const k = Math.min(Math.max(curve.findIndex(([s]) => s > x), 1), curve.length - 1), [a, b] = [curve[k - 1], curve[k]];
  return a[1] + ((x - a[0]) / (b[0] - a[0] || 1)) * (b[1] - a[1]);
}

// Log light of a pixel over time, as its events sum up.
function courseChart(view, course) {
  const end = 1e-6 * view.window_us, list = [[0, 0]];
  for (const e of course.events) list.push([1e-6 * e.t, e.before], [1e-6 * e.t, e.level]);
  list.push([end, list.at(-1)[1]]);
  const drawn = axesOf({ label: `Log light over ${say(end)} s, as ${course.events.length} events sum up`, x: [0, end], y: span(list.map(([, v]) => v)), across: "time [s]; dashed: triggers", up: "log light", size: [720, 210] });
  for (const t of view.triggers?.edge_us ?? []) {
    const x = drawn.at(1e-6 * (t - view.begin_us));
    if (x >= drawn.box.left && x <= drawn.box.right) svg("line", { x1: x, x2: x, y1: drawn.box.top, y2: drawn.box.bottom, class: "mark" }, drawn.chart);
  }
  svg("polyline", { points: points(list, drawn), class: "stairs" }, drawn.chart);
  return drawn.chart;
}
