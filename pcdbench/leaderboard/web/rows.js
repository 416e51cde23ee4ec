// Where numbers lead: the rows of a completer, and one of them with all that it holds.

const LISTED_SAMPLES = 60;

/** The rows that one number is made of, in a dialog. */
class Rows {
  constructor(board, choice) {
    Object.assign(this, { board, choice, sort: "worst" });
    this.dialog = document.querySelector("[data-place='rows']");
    this.dialog.addEventListener("close", () => choice.open !== null && choice.set({ open: null }));
    this.dialog.addEventListener("click", (event) => event.target === this.dialog && this.dialog.close());
  }

  draw() {
    const { choice, dialog } = this,
      wanted = choice.open !== null && choice.metric !== null;
    if (!wanted) return dialog.open ? dialog.close() : undefined;
    const kept = dialog.open ? dialog.scrollTop : 0;
    dialog.replaceChildren(...this.content());
    if (!dialog.open) dialog.showModal();
    dialog.scrollTop = kept;
    if (!kept) dialog.querySelector("[aria-expanded='true']")?.scrollIntoView({ block: "center" });
  }

  content() {
    const { board, choice } = this,
      { setting, metric, task, open } = choice;
    const completer = board.completers[open],
      { name, unit, direction } = board.metrics[metric],
      its = board.settings[setting];
    const heading = el(
      "header",
      {},
      el(
        "h2",
        {},
        isolated(completer.name),
        " ",
        el(
          "span",
          { class: "quiet" },
          isolated(board.tasks[task].name),
          " · ",
          isolated(name),
          " · ",
          isolated(board.incompletenesses[its.incompleteness]),
          ` ${board.levelText(setting)}`,
        ),
      ),
      el("button", { type: "button", "aria-label": "Close", click: () => this.dialog.close() }, "Close"),
    );
    const estimates = el(
      "p",
      {},
      Object.entries(STATISTICS).map(([key, title], i) => [
        i ? " · " : "",
        `${title} `,
        el("strong", {}, estimateText(board.result(setting, metric, open, key), unit)),
      ]),
    );
    const facts = el(
      "dl",
      { class: "facts" },
      completer.facts.map(([term, text]) => [el("dt", {}, term), el("dd", {}, isolated(text))]),
      completer.flags.map((flag) => [
        el("dt", {}, el("span", { class: "flag" }, flag.text)),
        el("dd", {}, isolated(flag.why)),
      ]),
    );
    const worse = direction === "lower" ? -1 : 1;
    const lines = board
      .casesIn(setting)
      .map((which) => ({ which, value: board.value(metric, which, open), row: board.row(which, open, task) }))
      .filter(({ row }) => row.status !== STATUSES.indexOf("not run"));
    // What failed is worse than any number.
    const measured = (line) => (Number.isNaN(line.value) ? -worse * Infinity : line.value);
    if (this.sort === "worst")
      lines.sort(
        (a, b) => Number(b.row.status !== OK) - Number(a.row.status !== OK) || worse * (measured(a) - measured(b) || 0),
      );
    const sorts = el(
      "p",
      { class: "sorts" },
      `${counted(lines.length, "row")}, ordered by `,
      ["worst", "case"].map((key) =>
        el(
          "button",
          {
            type: "button",
            "aria-pressed": String(this.sort === key),
            click: () => {
              this.sort = key;
              this.draw();
            },
          },
          { worst: "worst first", case: "case" }[key],
        ),
      ),
    );
    return [
      heading,
      estimates,
      facts,
      sorts,
      el(
        "div",
        { class: "lines" },
        lines.map((line) => this.line(line, metric, open)),
      ),
    ];
  }

  line({ which, value, row }, metric, completer) {
    const { board, choice } = this,
      opened = choice.case === which,
      { unit } = board.metrics[metric];
    const head = el(
      "button",
      {
        type: "button",
        class: "line-head",
        "aria-expanded": String(opened),
        click: () => choice.set({ case: opened ? null : which }),
      },
      el("span", { class: "case" }, isolated(board.caseText(which))),
      row.status === OK
        ? el("span", { class: "number" }, number(value, unit))
        : el("span", { class: "lost" }, STATUSES[row.status]),
      el("code", {}, row.key),
    );
    return el(
      "div",
      { class: opened ? "line open" : "line" },
      head,
      opened && this.detail(which, row, metric, completer),
    );
  }

  detail(which, row, metric, completer) {
    const { board, choice } = this,
      { unit } = board.metrics[metric],
      samples = board.samples(metric, which, completer);
    const parts = [];
    if (row.reason) parts.push(el("p", {}, `${STATUSES[row.status]}: `, isolated(row.reason)));
    if (samples?.length > 1) {
      const sorted = [...samples].sort((a, b) => a - b);
      parts.push(
        strip(sorted),
        el(
          "p",
          { class: "samples" },
          `${samples.length} samples, by size: ${sorted
            .slice(0, LISTED_SAMPLES)
            .map((one) => number(one, unit))
            .join("  ")}${sorted.length > LISTED_SAMPLES ? " …" : ""}`,
        ),
      );
    } else if (row.status === OK && !samples)
      parts.push(
        el(
          "p",
          { class: "quiet" },
          "The single samples are left out of this page for its size; leaderboard.json has them.",
        ),
      );
    const took = board.secondsOf(which, completer);
    if (Number.isFinite(took)) parts.push(el("p", { class: "quiet" }, `completed in ${seconds(took)}`));
    parts.push(
      el(
        "p",
        { class: "quiet" },
        "key of the row: ",
        el("code", {}, `${row.key}…`),
        "; to make this case and its completions again, and see them:",
      ),
      command(board, row.key),
      el(
        "p",
        {},
        el(
          "button",
          {
            type: "button",
            click: () => {
              choice.set({ open: null, case: which });
              document.querySelector("#case").scrollIntoView();
            },
          },
          "All completers on this case",
        ),
      ),
    );
    return el("div", { class: "detail" }, parts);
  }
}

/** Samples as strokes on a line, from the least to the greatest. */
function strip(sorted) {
  const its = scale(sorted[0], sorted.at(-1), 4, 596);
  return svg(
    "svg",
    { class: "strip", viewBox: "0 0 600 22", role: "img", "aria-label": "the samples on a line" },
    svg("path", { d: "M4 11H596" }),
    sorted.map((value) => svg("path", { class: "stroke", d: `M${its.at(value).toFixed(1)} 4v14` })),
  );
}

function command(board, key) {
  const text = `${board.case_command} ${key}`;
  const copied = el(
    "button",
    {
      type: "button",
      click: () =>
        navigator.clipboard?.writeText(text).then(() => {
          copied.textContent = "Copied";
        }),
    },
    "Copy",
  );
  return el("div", { class: "command" }, el("code", {}, text), copied);
}
