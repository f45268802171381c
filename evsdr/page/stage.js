// The viewer: tabs, what lies on the picture, and how pointer and keys move light, surface and pixel.
const KEYS = {
  light: "Arrow keys move the lamp, + and − zoom; a click shows the values of a pixel.",
  maps: "Arrow keys go from pixel to pixel, with Shift ten at a time, + and − zoom; a click shows the values of a pixel.",
  shape: "Arrow keys turn the surface, + and − zoom.",
  compare: "Arrow keys go from pixel to pixel, + and − zoom; drag to move the divider.",
};

// Where a picture lies in its frame when it is enlarged about a place: scale, left and top as shares of the frame.
function framing(scale, [x, y]) {
  const start = (at) => Math.min(Math.max(0.5 - at * scale, 1 - scale), 0);
  return { scale, left: start(x), top: start(y) };
}

function makeTabs(byId, chosen) {
  const names = ["light", "maps", "shape", "compare"], tabs = names.map((name) => byId(`tab-${name}`));
  const choose = (name, focus) => {
    names.forEach((other, k) => {
      tabs[k].setAttribute("aria-selected", String(other === name));
      tabs[k].tabIndex = other === name ? 0 : -1;
      byId(`panel-${other}`).hidden = other !== name;
      if (other === name && focus) tabs[k].focus();
    });
    byId("keys").textContent = KEYS[name];
    byId("frame").dataset.tab = name;
    chosen(name);
  };
  tabs.forEach((tab, k) => {
    tab.addEventListener("click", () => choose(names[k], false));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) choose(names[(k + step + names.length) % names.length], true);
    });
  });
  return choose;
}

const STILL = 4; // CSS pixels: what moves less is a click

// Tell of pointers on an element: `drag(x, y, dx, dy)` in shares of its size, `click(x, y)`, `zoom(factor)`.
function watch(element, { drag, click, zoom, free }) {
  const down = new Map();
  let moved = false, apart = 0;
  const share = (event) => {
    const box = element.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  element.addEventListener("pointerdown", (event) => {
    down.set(event.pointerId, [event.clientX, event.clientY, event.clientX, event.clientY]);
    element.setPointerCapture(event.pointerId);
    if (down.size === 1) moved = false;
    apart = 0;
  });
  element.addEventListener("pointermove", (event) => {
    const from = down.get(event.pointerId);
    if (!from) return;
    const box = element.getBoundingClientRect(), [dx, dy] = [event.clientX - from[2], event.clientY - from[3]];
    if (Math.hypot(event.clientX - from[0], event.clientY - from[1]) > STILL) moved = true;
    [from[2], from[3]] = [event.clientX, event.clientY];
    if (down.size === 2) {
      const [a, b] = [...down.values()], now = Math.hypot(a[2] - b[2], a[3] - b[3]);
      if (apart && zoom) zoom(now / apart);
      apart = now;
    } else if (moved && drag) drag(...share(event), dx / box.width, dy / box.height);
  });
  const up = (event) => {
    if (down.delete(event.pointerId) && !moved && event.type === "pointerup" && down.size === 0 && click) click(...share(event));
  };
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("wheel", (event) => {
    if (!zoom || !(free() || event.ctrlKey)) return; // else the page scrolls
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 500));
  }, { passive: false });
}

// Hatch what is not known, and mark the chosen pixel and the divider, over the picture.
function drawMarks(canvas, fit, { chosen, hatch, split, bare, frame }) {
  const box = canvas.getBoundingClientRect(), [w, h] = [box.width, box.height].map((v) => Math.max(1, Math.round(v * devicePixelRatio)));
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d"), [sx, sy] = [(frame.scale * w) / fit.width, (frame.scale * h) / fit.height];
  const [left, top] = [frame.left * w, frame.top * h];
  context.clearRect(0, 0, w, h);
  if (bare) return;
  if (hatch) {
    context.beginPath();
    fit.pixel.forEach((at) => {
      if (!(fit.state[at] & KNOWN)) context.rect(left + (at % fit.width) * sx, top + Math.floor(at / fit.width) * sy, sx, sy);
    });
    context.save();
    context.clip();
    context.lineWidth = devicePixelRatio;
    for (const [colour, shift] of [["#000b", 0], ["#fffb", 3 * devicePixelRatio]]) {
      context.strokeStyle = colour;
      context.beginPath();
      for (let d = shift; d < w + h; d += 6 * devicePixelRatio) {
        context.moveTo(d, 0);
        context.lineTo(d - h, h);
      }
      context.stroke();
    }
    context.restore();
  }
  if (split !== null) {
    for (const [colour, width] of [["#000a", 4], ["#fff", 2]]) {
      context.fillStyle = colour;
      context.fillRect(left + split * frame.scale * w - (width * devicePixelRatio) / 2, 0, width * devicePixelRatio, h);
    }
  }
  const [x, y] = [left + (chosen.x + 0.5) * sx, top + (chosen.y + 0.5) * sy], r = Math.max(7 * devicePixelRatio, sx);
  for (const [colour, width] of [["#000c", 4], ["#fff", 1.8]]) {
    context.strokeStyle = colour;
    context.lineWidth = width * devicePixelRatio;
    context.beginPath();
    context.arc(x, y, r, 0, 2 * Math.PI);
    context.stroke();
  }
}

// The pad: the hemisphere from above, with the LEDs of the ring and the lamp.
function drawPad(canvas, fit, direction) {
  const side = canvas.clientWidth || 180, ratio = devicePixelRatio, size = Math.round(side * ratio);
  if (canvas.width !== size) canvas.width = canvas.height = size;
  const context = canvas.getContext("2d"), style = getComputedStyle(canvas), r = size / 2 - 9 * ratio, m = size / 2;
  context.clearRect(0, 0, size, size);
  context.strokeStyle = style.getPropertyValue("--line");
  context.lineWidth = ratio;
  for (const part of [1, Math.cos(Math.PI / 6), 0.5]) {
    context.beginPath();
    context.arc(m, m, part * r, 0, 2 * Math.PI);
    context.stroke();
  }
  const dot = (d, radius, fill, stroke) => {
    context.beginPath();
    context.arc(m + d[0] * r, m - d[1] * r, radius * ratio, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
    context.strokeStyle = stroke;
    context.lineWidth = 1.5 * ratio;
    context.stroke();
  };
  fit.leds?.direction.forEach((d, j) => dot(d, 3, css(fit.band_colour[fit.leds.band[j]]), "transparent"));
  dot(direction, 8, "#ffd75e", style.getPropertyValue("--ink"));
}
