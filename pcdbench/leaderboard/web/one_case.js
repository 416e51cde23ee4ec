// One case of the board: the scores of every completer on it, and its clouds where the page holds them.

/** One case: what each completer scored on it, and its clouds side by side where the page holds them. */
class OneCase {
  constructor(board, choice) {
    Object.assign(this, { board, choice, shown: null, seen: false });
    this.select = document.querySelector("[data-choice='case']");
    this.table = document.querySelector("[data-place='case']");
    this.clouds = document.querySelector("[data-place='clouds']");
    this.select.addEventListener("change", () => choice.set({ case: Number(this.select.value) }));
    // Clouds are decoded when they come near, so that opening the page waits for none.
    new IntersectionObserver(
      (entries) => {
        if (!this.seen && entries.some((entry) => entry.isIntersecting)) {
          this.seen = true;
          this.draw();
        }
      },
      { rootMargin: "400px" },
    ).observe(this.clouds);
  }

  get which() {
    const its = this.board.casesIn(this.choice.setting);
    return this.choice.case ?? its.find((i) => this.board.clouds[i]) ?? its[0] ?? null;
  }

  drawChoice() {
    const { board, choice } = this;
    this.select.replaceChildren(
      ...board
        .casesIn(choice.setting)
        .map((i) => el("option", { value: i }, board.caseText(i) + (board.clouds[i] ? " (with clouds)" : ""))),
    );
  }

  draw() {
    const { which } = this;
    if (which === null) return;
    this.select.value = String(which);
    this.table.replaceChildren(this.scores(which));
    this.drawClouds(which);
  }

  scores(which) {
    const { board, choice } = this,
      columns = board.tasks
        .map((its, task) => [task, board.mainMetric(task)])
        .filter(([, metric]) => metric !== undefined);
    return el(
      "table",
      { class: "overview" },
      el("caption", { class: "quiet" }, "The case alone: the mean of its samples, of each task's main metric"),
      el(
        "thead",
        {},
        el(
          "tr",
          {},
          el("th", { scope: "col", class: "name" }, "completer"),
          columns.map(([task, metric]) =>
            el(
              "th",
              { scope: "col", class: "value" },
              isolated(board.tasks[task].name),
              el("span", { class: "under" }, isolated(board.metrics[metric].name)),
            ),
          ),
        ),
      ),
      el(
        "tbody",
        {},
        choice.shown.map((completer) =>
          el(
            "tr",
            { "data-completer": completer },
            el(
              "th",
              { scope: "row", class: "name" },
              swatch(board.look(completer)),
              isolated(board.completers[completer].name),
            ),
            columns.map(([task, metric]) => {
              const row = board.row(which, completer, task),
                value = board.value(metric, which, completer);
              return el(
                "td",
                { class: "value" },
                row.status !== STATUSES.indexOf("not run") &&
                  el(
                    "button",
                    {
                      type: "button",
                      class: "number",
                      click: () => choice.set({ task, metric, case: which, open: completer }),
                    },
                    row.status === OK
                      ? number(value, board.metrics[metric].unit)
                      : el("span", { class: "lost" }, STATUSES[row.status]),
                  ),
              );
            }),
          ),
        ),
      ),
    );
  }

  drawClouds(which) {
    const { board, choice } = this,
      held = board.clouds[which];
    if (!held) {
      // A task may not have measured this case; whichever did names it.
      const rows = board.tasks.flatMap((_, task) => board.completers.map((_, i) => board.row(which, i, task)));
      const run = rows.filter((its) => its.status !== STATUSES.indexOf("not run"));
      const row = run.find((its) => its.status === OK) ?? run[0];
      this.clouds.replaceChildren(
        el(
          "p",
          { class: "quiet" },
          "This page holds the clouds of a few cases only, those marked above. To make this one again and see it:",
        ),
        command(board, row.key),
      );
      this.shown = null;
      return;
    }
    if (!this.seen) return;
    const other = this.shown !== which;
    if (other) this.clouds.replaceChildren(document.getElementById(`clouds-${which}`).content.cloneNode(true));
    this.clouds.querySelectorAll(".panel").forEach((panel, i) => {
      panel.hidden = choice.hidden.has(held[i]);
    });
    if (other) document.dispatchEvent(new Event("pcdbench-viewers"));
    this.shown = which;
  }
}
