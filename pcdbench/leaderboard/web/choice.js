// What the reader has chosen, kept in the page's address after the "#", so that any view can be linked to.

class Choice {
  constructor(board, changed) {
    this.board = board;
    this.changed = changed;
    this.read();
    window.addEventListener("hashchange", () => {
      if (location.hash.slice(1) === this.text()) return;
      this.read();
      changed();
    });
  }

  /** Names that this board does not have are passed over: links live longer than boards. */
  read() {
    const board = this.board,
      given = new URLSearchParams(location.hash.slice(1));
    const index = (list, name, otherwise) => {
      const at = list.indexOf(name);
      return at < 0 ? otherwise : at;
    };
    const names = (list) => list.map((its) => its.name);
    const dataset = index(
      board.datasets.map((its) => its.label),
      given.get("data"),
      board.settings[board.first_setting].dataset,
    );
    const incompleteness = index(
      board.incompletenesses,
      given.get("incompleteness"),
      board.settings[board.first_setting].incompleteness,
    );
    const level = given.has("level") ? Number(given.get("level")) : board.settings[board.first_setting].level;
    this.setting = this.nearest(dataset, incompleteness, level);
    this.task = index(names(board.tasks), given.get("task"), null);
    this.metric = null;
    if (this.task !== null) {
      const its = board.metricsOf(this.task);
      this.metric =
        its[
          index(
            its.map((i) => board.metrics[i].name),
            given.get("metric"),
            its.indexOf(board.mainMetric(this.task)),
          )
        ];
    }
    this.statistic = given.get("statistic") in STATISTICS ? given.get("statistic") : null;
    this.sort = given.get("sort") ?? "";
    this.hidden = new Set(
      given
        .getAll("hide")
        .map((name) => index(names(board.completers), name, -1))
        .filter((i) => i >= 0),
    );
    this.open = index(names(board.completers), given.get("rows"), null);
    const which = board.casesIn(this.setting).find((i) => board.caseText(i) === given.get("case"));
    this.case = which ?? null;
  }

  /** The setting with these, or the next best: levels and ways to take points away differ between data sets. */
  nearest(dataset, incompleteness, level) {
    const badness = (its) =>
      100 * (its.dataset !== dataset) + 10 * (its.incompleteness !== incompleteness) + Math.abs(its.level - level);
    return this.board.settings.map((its, i) => [badness(its), i]).sort((a, b) => a[0] - b[0] || a[1] - b[1])[0][1];
  }

  text() {
    const { board } = this,
      given = new URLSearchParams(),
      { dataset, incompleteness, level } = board.settings[this.setting];
    if (board.datasets.length > 1) given.set("data", board.datasets[dataset].label);
    given.set("incompleteness", board.incompletenesses[incompleteness]);
    given.set("level", String(level));
    if (this.task !== null) given.set("task", board.tasks[this.task].name);
    if (this.metric !== null && this.metric !== board.mainMetric(this.task))
      given.set("metric", board.metrics[this.metric].name);
    if (this.statistic) given.set("statistic", this.statistic);
    if (this.sort) given.set("sort", this.sort);
    for (const completer of this.hidden) given.append("hide", board.completers[completer].name);
    if (this.open !== null) given.set("rows", board.completers[this.open].name);
    if (this.case !== null) given.set("case", board.caseText(this.case));
    return given.toString();
  }

  set(change) {
    Object.assign(this, change);
    if ("setting" in change && this.case !== null) {
      const its = this.board.caseText(this.case);
      this.case = this.board.casesIn(this.setting).find((i) => this.board.caseText(i) === its) ?? null;
    }
    // Replacing instead of adding: "back" leaves the page instead of walking through every click.
    history.replaceState(null, "", `#${this.text()}`);
    this.changed();
  }

  /** The metric's own statistic, unless the reader wants another one. */
  statisticOf(metric) {
    return this.statistic ?? this.board.metrics[metric].summary;
  }

  /** The completers that are shown, the references included, in the board's order. */
  get shown() {
    return this.board.completers.map((_, i) => i).filter((i) => !this.hidden.has(i));
  }
}
