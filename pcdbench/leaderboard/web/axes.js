// What all figures share: scales, axes with round ticks, marks, and a note that follows the pointer or the keys.

const SHAPES = [
  (x, y, r) => `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`,
  (x, y, r) => `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}Z`,
  (x, y, r) => `M${x} ${y - 1.3 * r}L${x + 1.3 * r} ${y}L${x} ${y + 1.3 * r}L${x - 1.3 * r} ${y}Z`,
];

/** What a completer's lines and marks look like. */
function swatch({ ink, dash, shape }) {
  return svg(
    "svg",
    { class: `swatch ${ink}`, width: 26, height: 12, viewBox: "0 0 26 12", "aria-hidden": "true" },
    svg("path", { class: "line", d: "M1 6H25", "stroke-dasharray": dash || null }),
    svg("path", { class: "mark", d: SHAPES[shape](13, 6, 3.5) }),
  );
}

/** A scale from values to pixels. Logarithmic ones are for values above zero. */
function scale(low, high, from, to, logarithmic = false) {
  const forward = logarithmic ? Math.log10 : (value) => value;
  if (!(high > low)) [low, high] = logarithmic ? [low / 2, low * 2] : [low - 0.5, low + 0.5];
  const [a, b] = [forward(low), forward(high)];
  const at = (value) => from + ((forward(value) - a) / (b - a)) * (to - from);
  const back = (pixel) => {
    const v = a + ((pixel - from) / (to - from)) * (b - a);
    return logarithmic ? 10 ** v : v;
  };
  return { at, back, low, high, logarithmic, from, to };
}

/** Round values within a scale. */
function ticks(its, wanted = 5) {
  if (its.logarithmic) {
    const decades = Math.log10(its.high / its.low),
      steps = decades > wanted ? [1] : decades > 1.5 ? [1, 3] : [1, 2, 5],
      found = [];
    const every = Math.max(1, Math.ceil(decades / (wanted + 1)));
    for (let power = Math.floor(Math.log10(its.low)); power <= Math.log10(its.high); power++) {
      if (power % every === 0) for (const step of steps) found.push(Number(`${step}e${power}`));
    }
    return found.filter((value) => value >= its.low * 0.999 && value <= its.high * 1.001);
  }
  const rough = (its.high - its.low) / wanted,
    decade = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((one) => one * decade >= rough) * decade,
    found = [];
  for (let i = Math.ceil(its.low / step - 1e-9); i * step <= its.high + 1e-9 * step; i++) found.push(i * step);
  return found;
}

function tickText(value) {
  if (Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  if (size < 0.01 || size >= 1e5) return tidy(value.toExponential(1).replace(".0e", "e"));
  return String(Number(value.toPrecision(3))).replace("-", "−");
}

/** An empty figure with its axes, drawn as wide as its place; `x.text` and `y.text` say what they are. */
function figure(place, x, y, { height = 310, name }) {
  const width = Math.max(280, Math.round(place.clientWidth || 480)),
    margin = { left: 52, right: 14, top: y.text ? 26 : 12, bottom: 44 };
  const across = x.scale(margin.left, width - margin.right),
    up = y.scale(height - margin.bottom, margin.top);
  const root = svg("svg", {
    viewBox: `0 0 ${width} ${height}`,
    width,
    height,
    tabindex: 0,
    role: "img",
    "aria-label": name,
  });
  const grid = svg("g", { class: "grid" }),
    labels = svg("g", { class: "labels" });
  for (const value of x.ticks?.(across) ?? ticks(across, width < 420 ? 4 : 6)) {
    const at = across.at(value);
    grid.append(svg("line", { x1: at, x2: at, y1: margin.top, y2: height - margin.bottom }));
    labels.append(
      svg("text", { x: at, y: height - margin.bottom + 17, "text-anchor": "middle" }, (x.label ?? tickText)(value)),
    );
  }
  for (const value of y.ticks?.(up) ?? ticks(up)) {
    const at = up.at(value);
    grid.append(svg("line", { y1: at, y2: at, x1: margin.left, x2: width - margin.right }));
    labels.append(svg("text", { x: margin.left - 7, y: at + 4, "text-anchor": "end" }, (y.label ?? tickText)(value)));
  }
  labels.append(
    svg(
      "text",
      { class: "axis", x: (margin.left + width - margin.right) / 2, y: height - 6, "text-anchor": "middle" },
      x.text,
    ),
  );
  if (y.text) labels.append(svg("text", { class: "up", x: 4, y: 13 }, y.text));
  // What leaves the axes (a tail beyond the last tick) must not run over the labels.
  const clip = `clip-${(figure.count = (figure.count ?? 0) + 1)}`;
  const box = {
    x: margin.left,
    y: margin.top - 4,
    width: width - margin.left - margin.right + 4,
    height: height - margin.top - margin.bottom + 8,
  };
  const marks = svg("g", { "clip-path": `url(#${clip})` });
  root.append(svg("clipPath", { id: clip }, svg("rect", box)), grid, labels, marks);
  place.replaceChildren(root);
  return { root, marks, x: across, y: up, width, height, margin };
}

/** The path through points, with breaks where one is missing. */
function pathOf(points) {
  let text = "",
    pen = "M";
  for (const [x, y] of points) {
    if (Number.isFinite(x) && Number.isFinite(y)) {
      text += `${pen}${x.toFixed(1)} ${y.toFixed(1)}`;
      pen = "L";
    } else pen = "M";
  }
  return text;
}

/** One note for the whole page: what the pointer is at. */
class Note {
  constructor() {
    this.element = el("div", { class: "note", role: "status", hidden: true });
    document.body.append(this.element);
  }

  show(x, y, ...lines) {
    this.element.replaceChildren(...lines.map((line) => el("div", {}, line)));
    this.element.hidden = false;
    const { offsetWidth: width, offsetHeight: height } = this.element,
      room = document.documentElement.clientWidth;
    this.element.style.left = `${Math.max(6, Math.min(x + 14, room - width - 6))}px`;
    this.element.style.top = `${y + height + 24 > innerHeight ? Math.max(6, y - height - 10) : y + 14}px`;
  }

  hide() {
    this.element.hidden = true;
  }
}

/** Lets the pointer and the arrow keys visit marks: each has x and y (pixels of the figure), completer and lines. */
function connectMarks(drawn, marks, { note, lit }) {
  const { root } = drawn;
  const dot = svg("circle", { class: "here", r: 5, visibility: "hidden" });
  root.append(dot);
  let visited = -1;
  const visit = (mark) => {
    if (!mark) return leave();
    const box = root.getBoundingClientRect(),
      factor = box.width / drawn.width || 1;
    for (const [name, value] of [
      ["cx", mark.x],
      ["cy", mark.y],
      ["visibility", "visible"],
    ])
      dot.setAttribute(name, value);
    note.show(box.left + mark.x * factor, box.top + mark.y * factor, ...mark.lines());
    lit(mark.completer);
  };
  const leave = () => {
    visited = -1;
    dot.setAttribute("visibility", "hidden");
    note.hide();
    lit(null);
  };
  root.addEventListener("pointermove", (event) => {
    const box = root.getBoundingClientRect(),
      factor = box.width / drawn.width || 1;
    visit(marks.nearest((event.clientX - box.left) / factor, (event.clientY - box.top) / factor));
  });
  root.addEventListener("pointerleave", leave);
  root.addEventListener("blur", leave);
  root.addEventListener("keydown", (event) => {
    const step = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowDown: [0, 1], ArrowUp: [0, -1] }[event.key];
    if (event.key === "Escape") return leave();
    if (!step) return;
    event.preventDefault();
    visited = marks.next(visited, step);
    visit(marks.at(visited));
  });
}

/** Marks of several completers, each visited in order: up and down change the completer, left and right the place. */
function marksOf(rows, reach = 60) {
  const all = rows.flat();
  return {
    at: (i) => all[i],
    nearest(x, y) {
      let best = null,
        least = reach ** 2;
      for (const mark of all) {
        const away = (mark.x - x) ** 2 + (mark.y - y) ** 2;
        if (away < least) [best, least] = [mark, away];
      }
      return best;
    },
    next(i, [along, down]) {
      if (i < 0) return all.length ? 0 : -1;
      const row = rows.findIndex((its) => its.includes(all[i])),
        place = rows[row].indexOf(all[i]);
      const other = rows[(row + down + rows.length) % rows.length];
      return all.indexOf(other[Math.min(other.length - 1, Math.max(0, place + along))]);
    },
  };
}
