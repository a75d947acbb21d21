// Plots of a report as SVG. Zoom: drag over a part; pinch; turn the wheel on a plot that was clicked,
// or with Ctrl; the keys + - and arrows. Back: double-click, double-tap, the button, or the key 0.
"use strict";
const SVG = "http://www.w3.org/2000/svg";
const MARGIN = { left: 62, right: 12, top: 10, bottom: 40 };

function element(parent, name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  if (text !== undefined) made.textContent = text;
  parent.appendChild(made);
  return made;
}

// Round numbers that divide a range into some `count` parts.
function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5, 10].find((m) => m * power >= raw) || 10);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

// 1, 2 and 5 times the powers of ten in a range of decimal logarithms.
function decades(low, high) {
  const found = [];
  for (let power = Math.floor(low); power <= high; power++)
    for (const digit of [1, 2, 5]) found.push(power + Math.log10(digit));
  return found.filter((at) => at >= low && at <= high);
}

const number = (value) => String(+value.toPrecision(4));

function extent(values) {
  let low = Infinity, high = -Infinity;
  for (const v of values) if (v !== null && v !== undefined) { low = Math.min(low, v); high = Math.max(high, v); }
  return low <= high ? [low, high] : [0, 1];
}

function widened([low, high], share) {
  const room = share * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - room, high + room];
}

class Plot {
  constructor(host, figure) {
    this.host = host; this.figure = figure; this.shown = null;
    this.place = figure.log ? Math.log : (x) => x;
    this.value = figure.log ? Math.exp : (x) => x;
    // what would lie below a logarithmic axis is drawn at its foot
    this.rise = figure.logValues ? (v) => Math.log10(Math.max(v, 1e-12)) : (v) => v;
    if (host.clientWidth) this.draw();
    new ResizeObserver(() => { if (host.clientWidth && host.clientWidth !== this.width) this.draw(); }).observe(host);
    this.fingers = new Map();
    host.tabIndex = 0;
    this.button = host.parentElement.querySelector("button");
    if (this.button) this.button.addEventListener("click", () => this.show(null));
    host.addEventListener("dblclick", () => this.show(null));
    host.addEventListener("pointerdown", (event) => this.press(event));
    host.addEventListener("wheel", (event) => this.turn(event), { passive: false });
    host.addEventListener("keydown", (event) => this.type(event));
  }

  // Show a range of places, the whole one for null.
  show(range) {
    const [first, last] = this.whole;
    if (range) {
      const least = (last - first) * 1e-4, size = Math.max(range[1] - range[0], least);
      const begin = Math.min(Math.max(range[0], first), last - Math.min(size, last - first));
      range = size < 0.999 * (last - first) ? [begin, Math.min(begin + size, last)] : null;
    }
    this.shown = range;
    if (this.button) this.button.hidden = !range;
    this.draw();
  }

  // Widen (factor above 1) or narrow what is shown, one place keeping its position.
  scale(factor, at) {
    const [low, high] = this.shown || this.whole;
    this.show([at + (low - at) * factor, at + (high - at) * factor]);
  }

  pixel(event) {
    const box = this.svg.getBoundingClientRect();
    return (event.clientX - box.left) * this.width / box.width;
  }

  turn(event) {
    // a wheel that passes over a plot is there to move the page
    if (!event.ctrlKey && !event.metaKey && document.activeElement !== this.host) return;
    event.preventDefault();
    this.scale(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 120) / 400), this.back(this.pixel(event)));
  }

  type(event) {
    const [low, high] = this.shown || this.whole, step = 0.2 * (high - low), middle = 0.5 * (low + high);
    const acts = {
      "+": () => this.scale(0.6, middle), "-": () => this.scale(1 / 0.6, middle), "0": () => this.show(null),
      ArrowLeft: () => this.shown && this.show([low - step, high - step]),
      ArrowRight: () => this.shown && this.show([low + step, high + step]),
    };
    if (!acts[event.key] || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    acts[event.key]();
  }

  // Keep what was under each of two fingers there.
  pinch() {
    const [a, b] = [...this.fingers.values()];
    if (Math.abs(b.now - a.now) < 12) return;
    const slope = (b.place - a.place) / (b.now - a.now), left = MARGIN.left, right = this.width - MARGIN.right;
    const range = [a.place + (left - a.now) * slope, a.place + (right - a.now) * slope];
    if (range[1] > range[0]) this.show(range);
  }

  get whole() {
    const all = [].concat(...this.figure.series.map((s) => s.x.map(this.place)));
    return this.figure.points ? widened(extent(all), 0.06) : extent(all);
  }

  // Range of the values within what is shown.
  range([low, high]) {
    const seen = this.figure.zero ? [0] : [];
    for (const s of this.figure.series) s.x.forEach((x, i) => {
      const at = this.place(x);
      if (at < low || at > high) return;
      const spread = s.error ? s.error[i] || 0 : 0;
      for (const y of s.low ? [s.low[i], s.high[i]] : [s.y[i]])
        if (y !== null) seen.push(this.rise(this.figure.logValues && y <= spread ? y : y - spread), this.rise(y + spread));
    });
    return widened(extent(seen), 0.05);
  }

  draw() {
    const width = this.width = this.host.clientWidth || 360;
    const height = Math.round(Math.max(190, Math.min(300, 0.55 * width)));
    const horizontal = this.shown || this.whole, vertical = this.range(horizontal);
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    this.x = (at) => MARGIN.left + (at - horizontal[0]) / (horizontal[1] - horizontal[0]) * (right - MARGIN.left);
    this.back = (px) => horizontal[0] + (px - MARGIN.left) / (right - MARGIN.left) * (horizontal[1] - horizontal[0]);
    this.y = (v) => bottom - (this.rise(v) - vertical[0]) / (vertical[1] - vertical[0]) * (bottom - MARGIN.top);
    const svg = document.createElementNS(SVG, "svg");
    for (const [key, v] of [["viewBox", `0 0 ${width} ${height}`], ["role", "img"], ["aria-label", this.figure.title]])
      svg.setAttribute(key, v);
    this.drawAxes(svg, horizontal, vertical, width, height);
    const clip = `clip${Plot.count = (Plot.count || 0) + 1}`;
    const rect = element(element(element(svg, "defs", {}), "clipPath", { id: clip }), "rect", {});
    for (const [key, v] of [["x", MARGIN.left], ["y", MARGIN.top - 5], ["width", right - MARGIN.left], ["height", bottom - MARGIN.top + 10]])
      rect.setAttribute(key, v);
    const area = element(svg, "g", { "clip-path": `url(#${clip})` });
    for (const series of this.figure.series) this.drawSeries(area, series);
    this.host.replaceChildren(svg);
    this.svg = svg;
  }

  drawAxes(svg, horizontal, vertical, width, height) {
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    const marks = this.figure.ticks ? this.figure.ticks.map(this.place)
      : ticks(horizontal[0], horizontal[1], Math.max(3, width / 110));
    for (const at of marks) {
      if (at < horizontal[0] || at > horizontal[1]) continue;
      element(svg, "line", { class: "grid", x1: this.x(at), x2: this.x(at), y1: MARGIN.top, y2: bottom });
      element(svg, "text", { x: this.x(at), y: bottom + 15, "text-anchor": "middle" }, String(+this.value(at).toPrecision(6)));
    }
    const heights = this.figure.logValues ? decades(...vertical).map((at) => 10 ** at) : ticks(vertical[0], vertical[1], 5);
    for (const v of heights) {
      element(svg, "line", { class: "grid", x1: MARGIN.left, x2: right, y1: this.y(v), y2: this.y(v) });
      element(svg, "text", { x: MARGIN.left - 6, y: this.y(v) + 4, "text-anchor": "end" }, number(v));
    }
    element(svg, "text", { x: (MARGIN.left + right) / 2, y: height - 6, "text-anchor": "middle" }, this.figure.horizontal);
    element(svg, "text", { transform: `translate(13 ${(MARGIN.top + bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, this.figure.vertical);
  }

  drawSeries(area, s) {
    const style = `--tone: var(--tone-${s.tone})`;
    const at = s.x.map((x) => this.x(this.place(x)).toFixed(1));
    if (s.low) {
      const edge = (values) => at.map((x, i) => `${x},${this.y(values[i] ?? 0).toFixed(1)}`);
      element(area, "polygon", { class: "band", style, points: [...edge(s.high), ...edge(s.low).reverse()].join(" ") });
    }
    if (s.y && s.kind !== "points") {
      let path = "", pen = "M";
      s.y.forEach((y, i) => {
        if (y === null) { pen = "M"; return; }
        path += `${pen}${at[i]} ${this.y(y).toFixed(1)}`; pen = "L";
      });
      element(area, "path", { class: `line ${s.kind || ""}`, style, d: path });
    }
    if (s.kind === "points") s.y.forEach((y, i) => {
      if (y === null) return;
      const spread = s.error[i] || 0, group = element(area, "g", { class: "point", style });
      element(group, "title", {}, `${s.name}, ${number(s.x[i])}: ${number(y)} ± ${number(+spread.toPrecision(2))}`);
      const [top, low] = [this.y(y + spread), this.y(y - spread)];
      element(group, "path", { d: `M${at[i]} ${top}V${low}M${at[i] - 4} ${top}h8M${at[i] - 4} ${low}h8` });
      element(group, "circle", { cx: at[i], cy: this.y(y), r: 3.6 });
    });
  }

  press(event) {
    if (event.button) return;
    const box = this.svg.getBoundingClientRect(), scale = this.width / box.width;
    const at = (e) => (e.clientX - box.left) * scale, start = at(event), id = event.pointerId;
    this.fingers.set(id, { now: start, place: this.back(start) });
    let mark = null;
    const move = (e) => {
      if (e.pointerId !== id) return;
      this.fingers.get(id).now = at(e);
      if (this.fingers.size > 1) { this.pinched = true; this.pinch(); return; }
      if (this.pinched || Math.abs(at(e) - start) < 6) return;
      mark = mark || element(this.svg, "rect", { class: "mark", y: MARGIN.top, height: box.height * scale - MARGIN.bottom - MARGIN.top });
      mark.setAttribute("x", Math.min(at(e), start)); mark.setAttribute("width", Math.abs(at(e) - start));
    };
    const end = (e) => {
      if (e.pointerId !== id) return;
      this.fingers.delete(id);
      removeEventListener("pointermove", move); removeEventListener("pointerup", end); removeEventListener("pointercancel", end);
      if (mark && e.type === "pointerup" && !this.pinched) this.show([this.back(start), this.back(at(e))].sort((a, b) => a - b));
      else if (mark) this.draw();
      if (!this.fingers.size) this.pinched = false;
    };
    addEventListener("pointermove", move); addEventListener("pointerup", end); addEventListener("pointercancel", end);
  }
}

const figures = JSON.parse(document.getElementById("figures").textContent);
const plots = [...document.querySelectorAll("[data-figure]")].map((host) => new Plot(host, figures[host.dataset.figure]));
// Nothing is folded on paper.
addEventListener("beforeprint", () => {
  document.querySelectorAll("details.point").forEach((d) => { d.open = true; });
  plots.forEach((plot) => plot.draw());
});
