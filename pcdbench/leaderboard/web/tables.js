// The ranking of one metric, and the overview of all tasks; references stand apart and are never sorted among methods.

class Tables {
  constructor(board, choice, lit, open) {
    Object.assign(this, { board, choice, lit, open });
    this.place = document.querySelector("[data-place='table']");
  }

  draw() {
    this.place.replaceChildren(this.choice.task === null ? this.overview() : this.ranking());
  }

  /** Methods in the chosen order between the references: truth and ceiling above, the floor below. */
  parts(columns, first) {
    const { board, choice } = this,
      shown = choice.shown;
    const [wanted, descending] = choice.sort.startsWith("-") ? [choice.sort.slice(1), true] : [choice.sort, false];
    const column = columns.find((its) => its.key === wanted) ?? columns.find((its) => its.key === first);
    const order = (a, b) => {
      const [x, y] = [column.sort(a), column.sort(b)];
      const none = (value) => value === null || Number.isNaN(value);
      if (none(x) !== none(y)) return none(x) - none(y);
      const before = none(x) ? 0 : typeof x === "string" ? x.localeCompare(y) : x - y;
      const further = (column.then ?? []).map((of) => of(a) - of(b)).find((its) => its);
      return (before || further || 0) * (descending ? -1 : 1) || a - b;
    };
    const role = (...roles) => shown.filter((i) => roles.includes(board.completers[i].role));
    return [
      { kind: "references", its: role("truth", "ceiling") },
      { kind: "methods", its: shown.filter((i) => !board.completers[i].role).sort(order) },
      { kind: "references", its: role("floor", "reference") },
    ].filter((part) => part.its.length);
  }

  table(caption, columns, first, kind) {
    const { choice } = this,
      sorted = choice.sort.replace("-", "") || first;
    const head = columns.map((column) => {
      const on = column.key === sorted,
        down = choice.sort.startsWith("-");
      const next = on ? (down ? column.key : `-${column.key}`) : column.key;
      const inside = column.sort
        ? el(
            "button",
            { type: "button", "data-sort": column.key, click: () => choice.set({ sort: next }) },
            column.title,
            el("span", { class: "way", "aria-hidden": "true" }, on ? (down ? " ▾" : " ▴") : ""),
          )
        : column.title;
      return el(
        "th",
        {
          scope: "col",
          role: "columnheader",
          class: column.class,
          "aria-sort": on ? (down ? "descending" : "ascending") : null,
        },
        inside,
        column.under?.(),
      );
    });
    const bodies = this.parts(columns, first).map((part) =>
      el(
        "tbody",
        { class: part.kind, role: "rowgroup" },
        part.its.map((completer) =>
          el(
            "tr",
            {
              role: "row",
              "data-completer": completer,
              pointerenter: () => this.lit(completer),
              pointerleave: () => this.lit(null),
            },
            columns.map((column) =>
              el(
                column.heads ? "th" : "td",
                { class: column.class, role: column.heads ? "rowheader" : "cell", scope: column.heads ? "row" : null },
                column.cell(completer),
              ),
            ),
          ),
        ),
      ),
    );
    return el(
      "table",
      { class: kind, role: "table" },
      el("caption", {}, caption),
      el("thead", { role: "rowgroup" }, el("tr", { role: "row" }, head)),
      bodies,
    );
  }

  completerColumn() {
    const { board } = this;
    return {
      key: "name",
      title: "completer",
      class: "name",
      heads: true,
      sort: (i) => board.completers[i].name,
      cell: (i) => {
        const its = board.completers[i],
          look = board.look(i);
        return [
          swatch(look),
          isolated(its.name),
          its.role &&
            el(
              "span",
              { class: "role" },
              { truth: "the truth", ceiling: "the ceiling", floor: "the floor", reference: "reference" }[its.role],
            ),
          its.flags.map((flag) => el("span", { class: "flag", title: flag.why }, flag.text)),
        ];
      },
    };
  }

  ranking() {
    const { board, choice } = this,
      { setting, metric } = choice,
      its = board.metrics[metric],
      chosen = choice.statisticOf(metric);
    const of = (completer, statistic = chosen) => board.result(setting, metric, completer, statistic);
    const better = (value) => (its.direction === "lower" ? value : -value);
    const range = rangesOf(choice.shown.map((i) => ({ role: board.completers[i].role, ...of(i) })));
    const columns = [
      {
        key: "rank",
        title: "rank",
        class: "rank",
        sort: (i) => of(i).rank,
        then: [(i) => -of(i).cases, (i) => better(of(i).value)], // who shares a rank
        cell: (i) => of(i).rank ?? "",
      },
      this.completerColumn(),
      { key: "plot", title: "", class: "plot", under: range.axis, cell: (i) => range.bar(of(i), board.look(i)) },
      {
        key: "value",
        title: `${STATISTICS[chosen]} [95 %]`,
        class: "value",
        sort: (i) => better(of(i).value),
        cell: (i) => this.link(i, estimateNodes(of(i), its.unit), `rows of ${board.completers[i].name}`),
      },
      ...Object.keys(STATISTICS)
        .filter((name) => name !== chosen)
        .map((name) => ({
          key: name,
          title: STATISTICS[name],
          class: "other",
          sort: (i) => better(of(i, name).value),
          cell: (i) => number(of(i, name).value, its.unit),
        })),
      {
        key: "cases",
        title: "cases",
        class: "cases",
        sort: (i) => -of(i).cases,
        cell: (i) => this.casesText(i, of(i)),
      },
      {
        key: "seconds",
        title: "time",
        class: "cost",
        sort: (i) => board.cost(setting, i).seconds,
        cell: (i) => (board.completers[i].role ? "" : seconds(board.cost(setting, i).seconds)),
      },
      {
        key: "memory",
        title: "memory",
        class: "cost",
        sort: (i) => board.cost(setting, i).memory,
        cell: (i) => (board.completers[i].role ? "" : megabytes(board.cost(setting, i).memory)),
      },
    ];
    return this.table(
      [
        el("strong", {}, isolated(board.tasks[choice.task].name), " · ", isolated(its.name)),
        ` ${its.unit ? `${its.unit}; ` : ""}${its.direction} is better`,
      ],
      columns,
      "rank",
      "ranking",
    );
  }

  overview() {
    const { board, choice } = this,
      { setting } = choice;
    const metrics = board.tasks.map((_, task) => board.mainMetric(task));
    const of = (completer, metric) => board.result(setting, metric, completer, choice.statisticOf(metric));
    const most = metrics.map((metric) => Math.max(...board.completers.map((_, i) => of(i, metric).cases)));
    const meanRank = (i) => {
      const ranks = metrics.map((metric) => of(i, metric).rank).filter((rank) => rank !== null);
      return ranks.length === metrics.filter((metric) => board.colored.some((j) => of(j, metric).rank)).length
        ? ranks.reduce((sum, rank) => sum + rank, 0) / ranks.length
        : null;
    };
    const columns = [
      this.completerColumn(),
      {
        key: "mean rank",
        title: "mean rank",
        class: "rank",
        sort: meanRank,
        cell: (i) => (meanRank(i) === null ? "" : meanRank(i).toFixed(1)),
      },
      ...metrics.map((metric, task) => ({
        key: `task ${board.tasks[task].name}`,
        class: "value",
        sort: (i) => (board.metrics[metric].direction === "lower" ? 1 : -1) * of(i, metric).value,
        title: [
          el("span", { class: "task" }, isolated(board.tasks[task].name)),
          el("span", { class: "under" }, [
            `${STATISTICS[choice.statisticOf(metric)]} `,
            isolated(board.metrics[metric].name),
            ` ${board.metrics[metric].direction === "lower" ? "↓" : "↑"}`,
          ]),
        ],
        cell: (i) => {
          const its = of(i, metric);
          return el(
            "button",
            {
              type: "button",
              class: `number${its.rank === 1 ? " best" : ""}`,
              title: estimateText(its, board.metrics[metric].unit),
              click: () => this.choice.set({ task, metric, sort: "", open: i }),
            },
            number(its.value, board.metrics[metric].unit),
            its.rank && el("span", { class: "place" }, `#${its.rank}`),
            its.failed > 0
              ? el("span", { class: "lost" }, `${its.failed} failed`)
              : its.cases > 0 &&
                  its.cases < most[task] &&
                  el("span", { class: "place" }, `${its.cases} of ${most[task]} cases`),
          );
        },
      })),
      {
        key: "seconds",
        title: "time",
        class: "cost",
        sort: (i) => board.cost(setting, i).seconds,
        cell: (i) => (board.completers[i].role ? "" : seconds(board.cost(setting, i).seconds)),
      },
    ];
    return el(
      "div",
      { class: "scrolls", tabindex: 0, role: "region", "aria-label": "All tasks" },
      this.table(
        el("span", {}, "All tasks, each by its main metric; ↓ lower is better, ↑ higher is better"),
        columns,
        "mean rank",
        "overview",
      ),
    );
  }

  link(completer, inside, name) {
    return el(
      "button",
      { type: "button", class: "number", title: name, click: () => this.choice.set({ open: completer }) },
      inside,
    );
  }

  casesText(completer, { cases, failed, skipped }) {
    const lost = [failed && `${failed} failed`, skipped && `${skipped} skipped`].filter(Boolean);
    return [String(cases), lost.length > 0 && el("span", { class: "lost" }, lost.join(", "))];
  }
}
