// The figures of a metric: its cumulative distribution, its value by level, and its value against time.

const CLIPPED_AT = 0.97; // a linear axis ends where this share of every completer's samples lies before it

class Figures {
  constructor(board, choice, note, lit) {
    Object.assign(this, { board, choice, note, lit });
    this.places = Object.fromEntries(
      ["distribution", "levels", "time"].map((name) => [name, document.querySelector(`[data-figure='${name}']`)]),
    );
  }

  draw() {
    const { metric } = this.choice;
    if (metric === null) return;
    this.drawDistribution(metric);
    this.drawLevels(metric);
    this.drawTime(metric);
  }

  name(completer) {
    return isolated(this.board.completers[completer].name);
  }

  what(metric) {
    const { name, unit } = this.board.metrics[metric];
    return unit && unit !== "share" ? `${name} (${unit})` : name;
  }

  line(completer, points) {
    const look = this.board.look(completer);
    return svg("path", {
      class: `line ${look.ink}`,
      "data-completer": completer,
      d: pathOf(points),
      "stroke-dasharray": look.dash || null,
    });
  }

  mark(completer, x, y, r = 5) {
    const look = this.board.look(completer);
    return svg("path", { class: `mark ${look.ink}`, "data-completer": completer, d: SHAPES[look.shape](x, y, r) });
  }

  drawDistribution(metric) {
    const { board, choice } = this,
      steps = board.curve_steps;
    const curves = choice.shown
      .map((completer) => [completer, board.curve(choice.setting, metric, completer)])
      .filter(([, its]) => its);
    const says = (name) => this.places.distribution.parentElement.querySelector(`[data-says='${name}']`);
    const caption = says("clipped");
    caption.textContent = "";
    // Boards keep the single samples of main metrics alone.
    const noun = board.metrics[metric].main ? "samples" : "cases";
    says("counted").textContent = { samples: "all samples", cases: "the means of cases" }[noun];
    if (!curves.length) return this.nothing("distribution");
    const last = (curve) => curve[Math.round(CLIPPED_AT * steps)];
    let low = Math.min(...curves.map(([, its]) => its[0])),
      high = Math.max(...curves.map(([, its]) => its[steps]));
    const near = Math.max(...curves.map(([, its]) => last(its)));
    if (board.metrics[metric].direction === "lower" && near > 0 && high > 1.5 * near) {
      high = near;
      caption.textContent = ` The axis ends at ${tickText(Number(high.toPrecision(3)))}: beyond it lies at most 3 % of any curve.`;
    }
    if (low > 0 && low < 0.4 * high) low = 0;
    const drawn = figure(
      this.places.distribution,
      { text: this.what(metric), scale: (from, to) => scale(low, high, from, to) },
      {
        scale: (from, to) => scale(0, 1, from, to),
        ticks: () => [0, 0.25, 0.5, 0.75, 1],
        label: (share) => percent(share),
      },
      { name: `Cumulative distribution of ${board.metrics[metric].name}. Arrow keys visit the curves.` },
    );
    const rows = [];
    for (const [completer, curve] of curves) {
      const points = [...curve].map((value, i) => [drawn.x.at(value), drawn.y.at(i / steps)]);
      points.unshift([drawn.x.from, drawn.y.at(0)]);
      points.push([Math.max(drawn.x.to, points.at(-1)[0]), drawn.y.at(1)]);
      drawn.marks.append(this.line(completer, points));
      rows.push(
        [...curve]
          .map((value, i) => ({
            x: drawn.x.at(value),
            y: drawn.y.at(i / steps),
            completer,
            lines: () => [
              this.name(completer),
              `${percent(i / steps)} of ${noun} at most ${number(value, board.metrics[metric].unit)}`,
            ],
          }))
          .filter((mark) => mark.x <= drawn.x.to + 1),
      );
    }
    connectMarks(drawn, marksOf(rows), this);
  }

  drawLevels(metric) {
    const { board, choice } = this,
      levels = board.levelsBeside(choice.setting),
      statistic = choice.statisticOf(metric);
    const results = choice.shown
      .map((completer) => [completer, levels.map((setting) => board.result(setting, metric, completer, statistic))])
      .filter(([, its]) => its.some((one) => Number.isFinite(one.value)));
    if (!results.length) return this.nothing("levels");
    const [low, high] = this.extent(results.flatMap(([, its]) => its));
    const drawn = figure(
      this.places.levels,
      {
        text: "missing",
        scale: (from, to) => scale(-0.35, levels.length - 0.65, from, to),
        ticks: () => levels.map((_, i) => i),
        label: (i) => board.levelText(levels[i]),
      },
      { text: `${STATISTICS[statistic]} ${this.what(metric)}`, scale: (from, to) => scale(low, high, from, to) },
      { name: `${STATISTICS[statistic]} of ${board.metrics[metric].name} by level. Arrow keys visit the marks.` },
    );
    const rows = results.map(([completer, its], place) => {
      // Side by side, or whiskers of one level would hide each other.
      const aside = ((place + 0.5) / results.length - 0.5) * Math.min(0.45, 0.05 * results.length);
      const places = its.map((one, i) => [drawn.x.at(i + aside), drawn.y.at(one.value)]);
      drawn.marks.append(this.line(completer, places));
      return its
        .map((one, i) => {
          const [x, y] = places[i];
          if (!Number.isFinite(y)) return null;
          const whisker = Number.isFinite(one.low) && `M${x} ${drawn.y.at(one.low)}V${drawn.y.at(one.high)}`;
          if (whisker)
            drawn.marks.append(
              svg("path", { class: `whisker ${board.look(completer).ink}`, "data-completer": completer, d: whisker }),
            );
          drawn.marks.append(this.mark(completer, x, y, 4));
          return {
            x,
            y,
            completer,
            lines: () => [
              this.name(completer),
              `${board.levelText(levels[i])} missing: ${estimateText(one, board.metrics[metric].unit)}`,
            ],
          };
        })
        .filter(Boolean);
    });
    connectMarks(drawn, marksOf(rows), this);
  }

  drawTime(metric) {
    const { board, choice } = this,
      statistic = choice.statisticOf(metric);
    const its = choice.shown
      .map((completer) => ({
        completer,
        ...board.result(choice.setting, metric, completer, statistic),
        ...board.cost(choice.setting, completer),
      }))
      .filter((one) => Number.isFinite(one.value));
    const timed = its.filter((one) => !board.completers[one.completer].role && one.seconds > 0);
    if (!timed.length) return this.nothing("time");
    const [low, high] = this.extent(its);
    const [fastest, slowest] = [
      Math.min(...timed.map((one) => one.seconds)),
      Math.max(...timed.map((one) => one.seconds)),
    ];
    const { direction, unit, name } = board.metrics[metric];
    const drawn = figure(
      this.places.time,
      {
        text: "seconds to complete a cloud (median, logarithmic)",
        scale: (from, to) => scale(fastest / 1.8, slowest * 1.8, from, to, true),
      },
      { text: `${STATISTICS[statistic]} ${this.what(metric)}`, scale: (from, to) => scale(low, high, from, to) },
      { name: `${STATISTICS[statistic]} of ${name} against seconds. Arrow keys visit the marks.` },
    );
    const across = [];
    for (const one of its.filter(({ completer }) => board.completers[completer].role)) {
      const y = drawn.y.at(one.value);
      drawn.marks.append(
        this.line(one.completer, [
          [drawn.x.from, y],
          [drawn.x.to, y],
        ]),
      );
      across.push({ x: drawn.x.to - 4, y: y - 4, end: true, text: short(board.completers[one.completer].name) });
    }
    const better = (a, b) => (direction === "lower" ? a < b : a > b),
      front = [];
    for (const one of [...timed].sort((a, b) => a.seconds - b.seconds)) {
      if (!front.length || better(one.value, front.at(-1).value)) front.push(one);
    }
    const stairs = front.flatMap((one, i) => [
      ...(i ? [[drawn.x.at(one.seconds), drawn.y.at(front[i - 1].value)]] : []),
      [drawn.x.at(one.seconds), drawn.y.at(one.value)],
    ]);
    drawn.marks.append(svg("path", { class: "front", d: pathOf([...stairs, [drawn.x.to, stairs.at(-1)[1]]]) }));
    const labels = [];
    const rows = timed.map((one) => {
      const [x, y] = [drawn.x.at(one.seconds), drawn.y.at(one.value)],
        { ink } = board.look(one.completer);
      if (Number.isFinite(one.low))
        drawn.marks.append(
          svg("path", {
            class: `whisker ${ink}`,
            "data-completer": one.completer,
            d: `M${x} ${drawn.y.at(one.low)}V${drawn.y.at(one.high)}`,
          }),
        );
      drawn.marks.append(this.mark(one.completer, x, y));
      if (timed.length <= 8) {
        const end = x > drawn.x.to - 110;
        labels.push({ x: x + (end ? -9 : 9), y: y + 4, end, text: short(board.completers[one.completer].name) });
      }
      return [
        {
          x,
          y,
          completer: one.completer,
          lines: () => [
            this.name(one.completer),
            estimateText(one, unit),
            `${seconds(one.seconds)}, ${megabytes(one.memory)}`,
          ],
        },
      ];
    });
    // Those beside marks come first: they say whose mark it is, and a line is told anywhere along it.
    const told = apart(
      [...labels, ...across],
      rows.map(([its]) => its),
      drawn.margin.top,
      drawn.height - drawn.margin.bottom + 4,
    );
    for (const { x, y, end, text } of told)
      drawn.marks.append(svg("text", { class: "beside", x, y, "text-anchor": end ? "end" : "start" }, text));
    connectMarks(drawn, marksOf(rows), this);
  }

  /** From the least to the greatest of values and intervals; zero is in it where it is near. */
  extent(results) {
    const all = results.flatMap((one) => [one.value, one.low, one.high]).filter(Number.isFinite);
    let [low, high] = [Math.min(...all), Math.max(...all)];
    if (low > 0 && low < 0.5 * high) low = 0;
    const room = 0.06 * (high - low || Math.abs(high) || 1);
    return [low === 0 ? 0 : low - room, high + room];
  }

  nothing(name) {
    this.places[name].replaceChildren(
      el("p", { class: "nothing" }, "Nothing to draw: no shown completer has numbers here."),
    );
  }
}

const LETTER = 6.8; // pixels, a little more than the mean letter of a label

/** Labels moved up or down, as little as will do, until none lies on another, on a mark or outside of [top, bottom]. */
function apart(labels, marks, top, bottom) {
  const taken = marks.map(({ x, y }) => ({ left: x - 7, right: x + 7, top: y - 7, bottom: y + 7 }));
  for (const its of labels) {
    const width = LETTER * its.text.length,
      left = its.end ? its.x - width : its.x;
    const boxAt = (y) => ({ left, right: left + width, top: y - 11, bottom: y + 3 });
    const free = (box) =>
      box.top >= top &&
      box.bottom <= bottom &&
      !taken.some((o) => box.left < o.right && o.left < box.right && box.top < o.bottom && o.top < box.bottom);
    for (let step = 0; step < bottom - top; step++) {
      const y = [its.y + step, its.y - step].find((one) => free(boxAt(one)));
      if (y === undefined) continue;
      its.y = y;
      break;
    }
    taken.push(boxAt(its.y));
  }
  return labels;
}

const short = (name) => (name.length > 18 ? `${name.slice(0, 17)}…` : name);
