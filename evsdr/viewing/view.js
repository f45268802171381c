// What ties the page together.
const byId = (id) => document.getElementById(id);

main().catch((error) => {
  byId("trouble").textContent = `This page can't show its pictures: ${error.message}. All words and numbers stand below.`;
  byId("trouble").hidden = false;
});

const ALL = 255; // bits: a picture holds for all pixels
const KINDS_OF_PIXEL = [
  [(bits) => bits & HOT, [0.86, 0.22, 0.18], "hot: fires far more than its neighbours"],
  [(bits) => bits & SILENT, [0.2, 0.45, 0.85], "silent, though its neighbours are not"],
  [(bits) => bits & SATURATED, [0.93, 0.72, 0.28], "can't keep up with the light"],
  [(bits) => bits & LIT, [0.42, 0.6, 0.5], "sees the light"],
  [() => true, [0.16, 0.17, 0.19], "sees little or nothing"],
];

function picturesOf(view) {
  const kinds = () => Uint8Array.from({ length: 3 * view.n }, (_, k) => 255 * KINDS_OF_PIXEL.find(([is]) => is(view.state[Math.floor(k / 3)]))[1][k % 3]);
  const all = view.on.map((v, k) => v + view.off[k]);
  const slots = (view.schedule?.order ?? []).map((led, k) => ({
    id: `slot_${k}`, slot: k, name: `Events of slot ${k}: ${led < 0 ? "dark" : `LED ${led}`}`, words: "Events while this LED fades into the next, of those that the page holds.", bit: ALL, ramp: "sea", zero: true, values: () => countInSlot(view, k),
  }));
  return [
    { id: "events", name: "Events", words: "Events of each pixel.", bit: ALL, ramp: "sea", zero: true, values: () => all },
    { id: "kinds", name: "Hot, silent, saturated", words: "", bit: ALL, legend: KINDS_OF_PIXEL, colours: kinds },
    { id: "share", name: "Share of brighter events", words: "Of a pixel's events, those that say brighter.", bit: LIT, ramp: "heat", values: () => all.map((v, k) => view.on[k] / Math.max(v, 1)) },
    ...slots,
  ];
}

async function main() {
  if (typeof DecompressionStream === "undefined") throw new Error("the browser is too old to unpack them; use one of 2023 or later");
  const view = await openWatched(JSON.parse(byId("evsdr-view").textContent)), pictures = picturesOf(view);
  const state = { chosen: busiest(view), scale: 1, middle: [0.5, 0.5] };
  byId("frame").dataset.tab = "maps";
  byId("frame").style.aspectRatio = `${view.width} / ${view.height}`;
  byId("frame").style.setProperty("--shape", String(view.width / view.height));
  byId("frame").classList.toggle("coarse", Math.max(view.width, view.height) < 256);
  [byId("flat").width, byId("flat").height] = [view.width, view.height];
  pictures.forEach((p) => byId("map").append(new Option(p.name, p.id)));
  const current = () => pictures.find((p) => p.id === byId("map").value);

  const marks = () => {
    const frame = framing(state.scale, state.middle);
    byId("flat").style.transform = `translate(${100 * frame.left}%, ${100 * frame.top}%) scale(${frame.scale})`;
    drawMarks(byId("marks"), view, { chosen: state.chosen, hatch: false, split: null, bare: false, frame });
  };
  const showPicture = async () => {
    const picture = current(), ready = await prepare(view, picture), context = byId("flat").getContext("2d"), image = context.createImageData(view.width, view.height);
    paint(image, view, picture, ready);
    context.putImageData(image, 0, 0);
    byId("map-words").replaceChildren(picture.words, ...(picture.legend ?? []).map(legendEntry));
    byId("scale").hidden = !ready.ends;
    byId("map-numbers").textContent = ready.values ? summarise(view, picture, ready.values) : "";
    if (ready.ends) {
      [byId("low").textContent, byId("high").textContent] = ready.ends.map((v) => say(v));
      drawRamp(byId("ramp"), picture);
    }
    if (view.schedule) byId("slots").replaceChildren(slotChart(view.schedule, picture.slot, (k) => showNamed(`slot_${k}`)));
    marks();
  };
  const showNamed = (id) => { byId("map").value = id; return showPicture(); };
  const choose = (x, y) => {
    state.chosen = { x: Math.min(Math.max(x, 0), view.width - 1), y: Math.min(Math.max(y, 0), view.height - 1) };
    [byId("column").value, byId("row").value] = [String(state.chosen.x), String(state.chosen.y)];
    showCourse(view, nearestStored(view, state.chosen));
    marks();
  };
  handle(view, state, { choose, marks });
  byId("map").addEventListener("change", showPicture);
  drawAll(view);
  await showPicture();
  choose(state.chosen.x, state.chosen.y);
  window.evsdr = { view, choose, show: showNamed, course: (x, y) => courseOf(view, x, y), model: (x, y) => modelOf(view, x, y), slot: (k) => Array.from(countInSlot(view, k)) };
  document.documentElement.dataset.ready = "yes";
}

// The lit pixel that fires about as often as most, and lies nearest to their middle.
function busiest(view) {
  const lit = view.pixel.filter((at) => view.state[at] & LIT && !(view.state[at] & HOT)), all = lit.length ? lit : view.pixel, w = view.width;
  const mean = all.reduce((s, at) => [s[0] + (at % w) / all.length, s[1] + Math.floor(at / w) / all.length], [0, 0]);
  const far = (at) => ((at % w) - mean[0]) ** 2 + (Math.floor(at / w) - mean[1]) ** 2 - 0.02 * (view.on[at] + view.off[at]);
  const best = all.reduce((a, b) => (far(b) < far(a) ? b : a));
  return { x: best % w, y: Math.floor(best / w) };
}

const nearestStored = (view, { x, y }) => ({ x: x - (x % view.stride), y: y - (y % view.stride) });

// All charts that do not depend on a pixel.
function drawAll(view) {
  byId("rate").replaceChildren(rateChart(view.rate));
  const { schedule, triggers, beat } = view;
  for (const id of ["slots-figure", "shift-figure", "slots-table-figure", "folded-figure"]) byId(id).hidden = !schedule;
  byId("triggers-figure").hidden = !triggers;
  if (triggers) byId("triggers").replaceChildren(triggerChart(triggers));
  byId("beat").replaceChildren(beatChart(beat));
  byId("beat-words").textContent = beat.against ? `how far ${beat.n} events against the light of their slot keep time` : "how far all events keep time";
  byId("beat-hint").textContent = beat.against
    ? beat.n < 20 ? "So few that they tell nothing: the light is steady." : "Lamps on the mains flicker 100 or 120 times a second. In slots shorter than half of that, a lamp that keeps time with the ring can't be seen."
    : "Lines of the ring and of lamps: without a schedule they can't be told apart.";
  if (schedule) {
    byId("shift").replaceChildren(shiftChart(schedule));
    byId("slots-table").replaceChildren(tableOf(["slot", "LED", "brighter", "darker"], schedule.order.map((led, k) => [String(k), ledName(led), String(schedule.on[k]), String(schedule.off[k])])));
  }
  const stored = view.stride > 1 ? ` Of every ${view.stride}th row and column only.` : "";
  byId("held").textContent = `${view.time.length.toLocaleString("en")} events of the first ${say(1e-6 * view.window_us)} s, with times to ${say(view.window_us / 65535, 2)} µs, and the number of all events of each pixel.${stored}`;
}

// A pixel in words, charts and numbers.
function showCourse(view, { x, y }) {
  const course = courseOf(view, x, y), model = view.schedule ? modelOf(view, x, y) : null;
  const kinds = KINDS_OF_PIXEL.filter(([is], k) => k < 3 && is(course.bits)).map(([, , words]) => words.split(":")[0]);
  byId("pixel-words").textContent = `Column ${x}, row ${y}: ${course.on + course.off} events, ${course.on} brighter and ${course.off} darker${kinds.length ? `; ${kinds.join(", ")}` : ""}.`;
  if (view.schedule) {
    const folded = foldedOf(view, course), n = view.schedule.order.length;
    const curve = model ?? folded.mean.map((v, k) => [((k + 0.5) * n) / folded.mean.length, v]);
    const words = model ? "light by the quick fit" : "mean of all rounds";
    byId("model-name").textContent = words;
    byId("folded").replaceChildren(foldedChart(view, folded, course.events.length || model ? curve : [], words));
    const rows = view.schedule.order.map((led, k) => [String(k), ledName(led), String(folded.events.filter((e) => Math.floor(e.at) === k && e.up).length), String(folded.events.filter((e) => Math.floor(e.at) === k && !e.up).length), say(at(curve, k), 3)]);
    byId("pixel-table").replaceChildren(tableOf(["slot", "LED", "brighter", "darker", "log light at its start"], rows));
  } else byId("pixel-table").replaceChildren(tableOf(["second", "polarity"], course.events.slice(0, 200).map((e) => [(1e-6 * e.t).toFixed(6), e.up ? "brighter" : "darker"])));
  byId("course").replaceChildren(courseChart(view, course));
}

// Pointer and keys.
function handle(view, state, { choose, marks }) {
  const place = (x, y) => {
    const { scale, left, top } = framing(state.scale, state.middle);
    return [Math.floor(((x - left) / scale) * view.width), Math.floor(((y - top) / scale) * view.height)];
  };
  const enlarge = (factor) => {
    if (state.scale === 1) state.middle = [(state.chosen.x + 0.5) / view.width, (state.chosen.y + 0.5) / view.height];
    state.scale = Math.min(Math.max(state.scale * factor, 1), 32);
    marks();
  };
  watch(byId("frame"), {
    click: (x, y) => choose(...place(x, y)),
    drag: (x, y, dx, dy) => {
      if (state.scale === 1) return choose(...place(x, y));
      const { scale, left, top } = framing(state.scale, state.middle);
      state.middle = [(0.5 - left - dx) / scale, (0.5 - top - dy) / scale];
      marks();
    },
    zoom: enlarge,
    free: () => false,
  });
  for (const [id, factor] of [["nearer", 1.5], ["farther", 1 / 1.5]]) byId(id).addEventListener("click", () => enlarge(factor));
  byId("frame").addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if ("+-".includes(event.key)) enlarge(event.key === "+" ? 1.25 : 0.8);
    if (!step) return;
    event.preventDefault();
    choose(state.chosen.x + step[0] * (event.shiftKey ? 10 : 1), state.chosen.y + step[1] * (event.shiftKey ? 10 : 1));
  });
  byId("where").addEventListener("input", () => choose(Number(byId("column").value), Number(byId("row").value)));
  byId("where").addEventListener("submit", (event) => event.preventDefault());
  [byId("column").max, byId("row").max] = [String(view.width - 1), String(view.height - 1)];
  new ResizeObserver(() => marks()).observe(byId("frame"));
}
