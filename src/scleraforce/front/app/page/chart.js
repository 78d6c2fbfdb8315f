// Plots as SVG in the page's colours, which a download keeps.

const SVG = "http://www.w3.org/2000/svg";
const MARGIN = { left: 52, right: 12, top: 26, bottom: 34 };
const TICKS = 5;

function drawn(name, attributes, text) {
  const found = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) found.setAttribute(key, value);
  if (text !== undefined) found.textContent = text;
  return found;
}

// Round steps of 1, 2 or 5 times a power of ten.
export function ticks(low, high, count = TICKS) {
  const rough = Math.max(high - low, 1e-12) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((times) => times * power).find((each) => each >= rough);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) found.push(n * step);
  return { values: found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// How answers are marked, by shape and colour.
export const MARKS = {
  right: "agrees with the label", missed: "interval misses the label", wrong: "wrong class", both: "wrong class, interval misses the label", none: "not compared",
};

// The shapes of a mark about a point.
function shapes(kind, x, y) {
  const found = [];
  const size = kind === "both" ? 7.5 : 6;
  if (kind === "missed" || kind === "both") found.push(drawn("path", { class: "diamond", d: `M${x} ${y - size}l${size} ${size}l${-size} ${size}l${-size} ${-size}z` }));
  if (kind === "wrong" || kind === "both") {
    const arm = kind === "both" ? 3 : 4.5;
    found.push(drawn("path", { class: "cross", d: `M${x - arm} ${y - arm}l${2 * arm} ${2 * arm}m0 ${-2 * arm}l${-2 * arm} ${2 * arm}` }));
  }
  return found.length ? found : [drawn("circle", { class: kind === "none" ? "dot hollow" : "dot", cx: x, cy: y, r: 3.5 })];
}

// A mark of its own, for tables and legends.
export function markOf(kind) {
  const svg = drawn("svg", { class: "mark", viewBox: "0 0 18 18", "aria-hidden": "true" });
  svg.append(...shapes(kind, 9, 9));
  return svg;
}

const extent = (values) => {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null || !Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return low > high ? [0, 1] : low === high ? [low - 0.5, high + 0.5] : [low, high];
};

export class Chart {
  // `x` and `y`: all values that are to fit; `labels`: of the axes.
  constructor(svg, { x, y, labels, zero = false }) {
    const { width, height } = svg.getBoundingClientRect();
    Object.assign(this, { svg, width: Math.max(width, 200), height: Math.max(height, 80) });
    const [low, high] = extent(zero ? [...y, 0] : y);
    const pad = 0.06 * (high - low);
    this.x = extent(x);
    this.y = [low === 0 ? 0 : low - pad, high + pad];
    svg.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    svg.replaceChildren();
    this.#axes(labels);
  }

  left(value) {
    return MARGIN.left + ((value - this.x[0]) / (this.x[1] - this.x[0])) * (this.width - MARGIN.left - MARGIN.right);
  }

  top(value) {
    return this.height - MARGIN.bottom - ((value - this.y[0]) / (this.y[1] - this.y[0])) * (this.height - MARGIN.top - MARGIN.bottom);
  }

  // The value of x under a pointer.
  under(event) {
    const box = this.svg.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width) * this.width - MARGIN.left;
    return this.x[0] + (share / (this.width - MARGIN.left - MARGIN.right)) * (this.x[1] - this.x[0]);
  }

  add(name, attributes, text) {
    const found = drawn(name, attributes, text);
    this.svg.append(found);
    return found;
  }

  #axes(labels) {
    const bottom = this.height - MARGIN.bottom;
    const down = ticks(...this.y, Math.max(2, Math.floor(this.height / 32)));
    for (const value of down.values) {
      const y = this.top(value);
      this.add("line", { class: "grid", x1: MARGIN.left, x2: this.width - MARGIN.right, y1: y, y2: y });
      this.add("text", { class: "soft", x: MARGIN.left - 6, y: y + 4, "text-anchor": "end" }, value.toFixed(down.digits));
    }
    const across = ticks(...this.x, Math.max(2, Math.floor(this.width / 110)));
    for (const value of across.values) {
      this.add("text", { class: "soft", x: this.left(value), y: bottom + 15, "text-anchor": "middle" }, value.toFixed(across.digits));
    }
    this.add("line", { class: "axis", x1: MARGIN.left, x2: this.width - MARGIN.right, y1: bottom, y2: bottom });
    this.add("text", { x: this.width - MARGIN.right, y: this.height - 4, "text-anchor": "end" }, labels[0]);
    this.add("text", { x: 4, y: 12 }, labels[1]);
  }

  line(xs, ys, kind = "line") {
    let path = "";
    let up = true;
    xs.forEach((x, n) => {
      if (ys[n] === null || ys[n] === undefined) up = true;
      else path += `${up ? "M" : "L"}${this.left(x).toFixed(1)} ${this.top(ys[n]).toFixed(1)}`;
      up = ys[n] === null || ys[n] === undefined;
    });
    return this.add("path", { class: kind, d: path });
  }

  // The stretch between the least and the largest values.
  band({ time_s: xs, low, high }, kind = "range") {
    const known = xs.map((_, n) => n).filter((n) => low[n] !== null);
    const there = known.map((n) => `${this.left(xs[n]).toFixed(1)} ${this.top(high[n]).toFixed(1)}`);
    const back = known.map((n) => `${this.left(xs[n]).toFixed(1)} ${this.top(low[n]).toFixed(1)}`).reverse();
    if (known.length) this.add("path", { class: kind, d: `M${[...there, ...back].join("L")}Z` });
  }

  level(value, text, kind = "bound") {
    if (value < this.y[0] || value > this.y[1]) return;
    const y = this.top(value);
    this.add("line", { class: kind, x1: MARGIN.left, x2: this.width - MARGIN.right, y1: y, y2: y });
    this.add("text", { class: "soft", x: this.width - MARGIN.right, y: y - 4, "text-anchor": "end" }, text);
  }

  upright(value, kind = "now") {
    return this.add("line", { class: kind, x1: this.left(value), x2: this.left(value), y1: MARGIN.top, y2: this.height - MARGIN.bottom });
  }

  // A point, by one of `MARKS`.
  mark(x, y, kind, title) {
    const group = this.add("g", { "data-mark": kind });
    group.append(drawn("title", {}, title), ...shapes(kind, this.left(x), this.top(y)));
  }

  bar(x, low, high, kind = "") {
    this.add("line", { class: `bar ${kind}`, x1: this.left(x), x2: this.left(x), y1: this.top(low), y2: this.top(high) });
  }
}

const LINE = 20; // pixels, of a legend

// The SVG as a file of its own: the style sheet's values are written into each element, and the legend of its marks stands below.
export function svgText(svg) {
  const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
  const kinds = Object.keys(MARKS).filter((kind) => svg.querySelector(`[data-mark=${kind}]`));
  const legend = svg.appendChild(drawn("g", {}));
  kinds.forEach((kind, n) => {
    const y = height + LINE * (n + 0.5);
    legend.append(...shapes(kind, MARGIN.left, y), drawn("text", { x: MARGIN.left + 14, y: y + 4 }, MARKS[kind]));
  });
  const text = styled(svg, width, height + LINE * kinds.length);
  legend.remove();
  return text;
}

function styled(svg, width, height) {
  const copy = svg.cloneNode(true);
  const kept = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linecap", "stroke-linejoin", "paint-order", "font-size", "font-family"];
  const all = [svg, ...svg.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((each, n) => {
    const style = getComputedStyle(all[n]);
    for (const name of kept) each.setAttribute(name, style.getPropertyValue(name));
  });
  copy.setAttribute("style", `background: ${getComputedStyle(document.documentElement).getPropertyValue("--card")}`);
  copy.setAttribute("viewBox", `0 0 ${width} ${height}`);
  copy.setAttribute("xmlns", SVG);
  return new XMLSerializer().serializeToString(copy);
}
