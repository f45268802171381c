// The events of a recording, pixel after pixel, and what a pixel's events say of its light.
const LIT = 1, HOT = 2, SILENT = 4, SATURATED = 8, STORED = 16;
const VIEW_FORMAT = "evsdr view 1";

async function openWatched(contents) {
  if (contents.format !== VIEW_FORMAT) throw new Error(`it is not of the format "${VIEW_FORMAT}"`);
  const n = contents.width * contents.height, layers = {};
  for (const [name, layer] of Object.entries(contents.layers)) layers[name] = await decodeLayer(layer);
  const count = Uint32Array.from(layers.count, Math.round), first = new Uint32Array(n + 1);
  count.forEach((c, at) => (first[at + 1] = first[at] + c));
  const place = Int32Array.from({ length: n }, (_, at) => at), state = Uint8Array.from(layers.state, Math.round);
  const on = layers.on.map(Math.round), off = layers.off.map(Math.round);
  return { ...contents, n, place, pixel: place, state, on, off, first, time: layers.time, polarity: layers.polarity, threshold: layers.threshold, light: layers.light, modelled: layers.modelled };
}

// Slot of a time [us since the first event], with the share that is over; -1 outside the rounds.
function slotAt(view, t) {
  const { start_us: starts, slot_us: slot, order } = view.schedule, at = t + view.begin_us;
  if (starts.length < 2 || at < starts[0] || at >= starts.at(-1)) return -1;
  let low = 0, high = starts.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (starts[middle] <= at) low = middle;
    else high = middle;
  }
  const length = starts[low + 1] - starts[low];
  return { round: low, at: Math.min(((at - starts[low]) / (Math.abs(length / (slot * order.length) - 1) < 0.5 ? length / order.length : slot)) % order.length, order.length - 1e-6) };
}

// How many events of each pixel lie in a slot; those of pixels without stored events are those of the nearest that has.
function countInSlot(view, slot) {
  const out = new Float32Array(view.n), { width, stride } = view;
  for (let at = 0; at < view.n; at++)
    for (let k = view.first[at]; k < view.first[at + 1]; k++) {
      const where = slotAt(view, view.time[k]);
      if (where !== -1 && Math.floor(where.at) === slot) out[at]++;
    }
  if (stride > 1) return out.map((_, at) => out[at - (at % width % stride) - width * (Math.floor(at / width) % stride)]);
  return out;
}

// The events of a pixel: time [us], polarity, and log light after each, summed up from them.
function courseOf(view, x, y) {
  const at = y * view.width + x, [begin, end] = [view.first[at], view.first[at + 1]], events = [];
  let on = 0, off = 0, level = 0;
  for (let k = begin; k < end; k++) view.polarity[k] > 0.5 ? on++ : off++;
  for (let k = begin; k < end; k++) {
    const up = view.polarity[k] > 0.5, before = level;
    level += view.threshold[at] * (up ? 1 : -on / Math.max(off, 1));
    events.push({ t: view.time[k], up, before, level });
  }
  return { x, y, events, on: view.on[at], off: view.off[at], bits: view.state[at] };
}

// The events by where they lie in a round, each round's mean taken off its levels.
function foldedOf(view, course) {
  const rounds = new Map();
  for (const event of course.events) {
    const where = slotAt(view, event.t);
    if (where === -1) continue;
    if (!rounds.has(where.round)) rounds.set(where.round, []);
    rounds.get(where.round).push({ ...event, at: where.at });
  }
  const n = view.schedule.order.length, out = [], sums = new Float32Array(4 * n), counts = new Float32Array(4 * n);
  for (const events of rounds.values()) {
    const stairs = levelsAt(events, sums.length, n), mean = stairs.reduce((a, b) => a + b, 0) / stairs.length;
    stairs.forEach((v, k) => { sums[k] += v - mean; counts[k]++; });
    for (const event of events) out.push({ ...event, level: event.level - mean, before: event.before - mean });
  }
  return { events: out, mean: Array.from(sums, (v, k) => v / Math.max(counts[k], 1)) };
}

// The level at even places of a round.
function levelsAt(events, count, n) {
  const out = new Array(count);
  for (let k = 0, e = 0, level = events[0].before; k < count; k++) {
    while (e < events.length && events[e].at <= ((k + 0.5) * n) / count) level = events[e++].level;
    out[k] = level;
  }
  return out;
}

// Log light over a round by the quick fit, [slot, log light] and its mean; null where it has none.
function modelOf(view, x, y) {
  const at = y * view.width + x;
  if (!view.light || view.modelled[at] < 0.5) return null;
  const { order, crossfade } = view.schedule, n = order.length, fine = 12;
  const dark = Math.min(...order.map((led) => (led < 0 ? 0 : 1))) === 0, veil = dark ? darkest(view, at) : 0;
  const lit = (led) => (led < 0 ? veil : view.light[led * view.n + at]), out = [];
  for (let k = 0; k <= n * fine; k++) {
    const slot = Math.min(Math.floor(k / fine), n - 1), over = k / fine - slot;
    const fade = crossfade ? Math.min(Math.max((over - 1 + crossfade) / crossfade, 0), 1) : 0;
    out.push([k / fine, Math.log((1 - fade) * lit(order[slot]) + fade * lit(order[(slot + 1) % n]))]);
  }
  const mean = out.reduce((a, [, v]) => a + v, 0) / out.length;
  return out.map(([s, v]) => [s, v - mean]);
}

// The constant light: no LED of any pixel is darker.
function darkest(view) {
  view.veil ??= view.light.reduce((a, b) => Math.min(a, b), Infinity);
  return view.veil;
}
