// Values with their intervals: as text, and as bars on one axis for a table's column.

/** Bars on one axis for a column: a dot, its interval, and lines where ceiling and floor are. */
function rangesOf(results) {
  const all = results.flatMap((its) => [its.value, its.low, its.high]).filter(Number.isFinite);
  const positive = all.filter((value) => value > 0),
    high = Math.max(...all),
    least = Math.min(...positive);
  const logarithmic = positive.length > 0 && Math.min(...all) >= 0 && high / least > 40;
  let low = logarithmic ? least / 1.3 : Math.min(...all);
  if (!logarithmic && low > 0 && low < 0.5 * high) low = 0;
  const its = scale(low, high, 2, 98, logarithmic);
  const at = (value) => `${Math.min(100, Math.max(0, logarithmic && value <= 0 ? 0 : its.at(value))).toFixed(2)}%`;
  const lines = results.filter((one) => ["ceiling", "floor"].includes(one.role) && Number.isFinite(one.value));
  const placed = (element, left, width) => {
    element.style.left = left;
    if (width) element.style.width = width;
    return element;
  };
  return {
    axis: () =>
      all.length > 0 &&
      el(
        "div",
        { class: "range axis" },
        placed(el("span", {}, tickText(Number(its.low.toPrecision(2)))), "0%"),
        el("span", { class: "end" }, `${tickText(Number(high.toPrecision(2)))}${logarithmic ? " (log)" : ""}`),
      ),
    bar: (one, look) => {
      if (!Number.isFinite(one.value)) return "";
      const bar = el(
        "div",
        { class: `range ${look.ink}`, "aria-hidden": "true" },
        lines.map((line) => placed(el("i", { class: `ruler ${line.role}` }), at(line.value))),
      );
      if (Number.isFinite(one.low))
        bar.append(
          placed(
            el("i", { class: "interval" }),
            at(one.low),
            `${(parseFloat(at(one.high)) - parseFloat(at(one.low))).toFixed(2)}%`,
          ),
        );
      bar.append(placed(el("i", { class: "dot" }), at(one.value)));
      return bar;
    },
  };
}

function estimateNodes({ value, low, high }, unit) {
  return [
    el("span", { class: "main" }, number(value, unit)),
    Number.isFinite(low) && el("span", { class: "between" }, ` [${number(low, unit)}, ${number(high, unit)}]`),
  ];
}

function estimateText({ value, low, high }, unit) {
  return number(value, unit) + (Number.isFinite(low) ? ` [${number(low, unit)}, ${number(high, unit)}]` : "");
}
