// What a preview shows: each message holds all that there is to show, newer ones replace it.
const byId = (id) => document.getElementById(id);
const TONES = { locked: "trustworthy", "not locked": "doubtful", waiting: "waiting" };
const NOBODY = { seen: "A recording is under way; this page follows it.", ended: "The recording has ended. This page keeps what it saw last.", lost: "The preview has gone; the recording may go on without it." };

const link = new WebSocket(`${location.origin.replace("http", "ws")}${location.pathname.replace(/\/?$/, "/feed")}`);
let ended = false;
let sharpest = 0;
link.addEventListener("open", () => (byId("link").textContent = NOBODY.seen));
link.addEventListener("message", (event) => {
  try {
    show(JSON.parse(event.data));
  } catch (error) {
    byId("trouble").textContent = `This page can't show what came: ${error.message}.`;
    byId("trouble").hidden = false;
  }
});
link.addEventListener("close", () => {
  byId("link").textContent = ended ? NOBODY.ended : NOBODY.lost;
  document.body.classList.toggle("over", !ended);
});

function show(told) {
  ended = told.ended;
  byId("lock").className = `verdict ${TONES[told.state]}`;
  for (const [id, text] of [["state", told.state], ["words", told.words]]) if (byId(id).textContent !== text) byId(id).textContent = text;
  byId("events").textContent = told.n_event.toLocaleString("en");
  document.documentElement.dataset.ready = "yes";
  if (!told.rate) return;
  byId("rounds").textContent = String(told.n_round);
  byId("agree").textContent = told.agree === null ? "–" : `${(100 * told.agree).toFixed(0)} %`;
  sharpest = Math.max(sharpest, told.sharpness ?? 0);
  byId("sharp").textContent = told.sharpness ? `${told.sharpness.toFixed(3)} · ${sharpest.toFixed(3)}` : "–";
  byId("now").textContent = ((told.rate.on.at(-2) ?? 0) + (told.rate.off.at(-2) ?? 0)).toLocaleString("en", { maximumSignificantDigits: 2 });
  byId("rate").replaceChildren(rateChart(told.rate));
  byId("slots").replaceChildren(slotChart(told.slots, -1, () => {}));
  byId("triggers-figure").hidden = !told.triggers;
  if (told.triggers) byId("triggers").replaceChildren(triggerChart(told.triggers));
  byId("skipped").textContent = told.skipped ? `${(told.skipped / 1e6).toFixed(1)} MB of the recording came too fast to be shown here; they are in the file.` : "";
  if (told.picture) showLeds(told.picture);
}

// A picture of each LED, painted anew.
function showLeds({ leds, width, height, data }) {
  const text = atob(data), grid = byId("leds");
  if (grid.childElementCount !== leds.length) {
    grid.replaceChildren(...leds.map(() => document.createElement("figure")));
    for (const figure of grid.children) figure.append(document.createElement("canvas"), document.createElement("figcaption"));
    byId("leds-hint").textContent = "Brighter and darker than in the mean of a round, as the events of the last rounds sum up. Where there are none, nothing is shown.";
  }
  leds.forEach((led, k) => {
    const [canvas, name] = grid.children[k].children;
    [canvas.width, canvas.height] = [width, height];
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `What LED ${led} lights`);
    name.textContent = `LED ${led}`;
    const context = canvas.getContext("2d"), image = context.createImageData(width, height);
    for (let i = 0, at = k * width * height; i < width * height; i++, at++) {
      const v = text.charCodeAt(at);
      if (v) image.data.set([v, v, v, 255], 4 * i);
    }
    context.putImageData(image, 0, 0);
  });
}
