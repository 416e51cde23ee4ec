// The board's data: what pcdbench/leaderboard/page_data.py packed, and where each number of it lies.

const STATISTICS = { median: "median", p90: "90th percentile", mean: "mean" };
const OK = 0,
  STATUSES = ["ok", "failed", "timed out", "skipped", "not run"];

class Board {
  constructor(data) {
    Object.assign(this, data);
    this.unpacked = new Map();
    this.estimates = Object.fromEntries(Object.keys(STATISTICS).map((name) => [name, floatsOf(data.estimates[name])]));
    this.curves = shortFloatsOf(data.curves);
    this.values = shortFloatsOf(data.values);
    for (const name of ["cases", "failed", "skipped", "ranks"]) this[`${name}Of`] = shortsOf(data.counts[name]);
    this.caseSetting = shortsOf(data.case_settings);
    this.caseScene = shortsOf(data.case_scenes);
    this.caseDraw = shortsOf(data.case_draws);
    this.caseSeed = shortsOf(data.case_seeds);
    this.statuses = bytesOf(data.statuses);
    this.keys = bytesOf(data.keys);
    this.rowReasons = shortsOf(data.row_reasons);
    this.seconds = floatsOf(data.seconds);
    this.memory = floatsOf(data.memory_mb);
    this.caseSeconds = shortFloatsOf(data.case_seconds);
    this.casesOf_ = this.settings.map((_, setting) =>
      [...this.caseSetting.keys()].filter((i) => this.caseSetting[i] === setting),
    );
    this.colored = this.completers.map((_, i) => i).filter((i) => !this.completers[i].role);
  }

  /** Which group of samples: those of a setting, metric and completer. */
  group(setting, metric, completer) {
    return (setting * this.metrics.length + metric) * this.completers.length + completer;
  }

  /** A statistic with its interval, counts and rank. */
  result(setting, metric, completer, statistic) {
    const group = this.group(setting, metric, completer),
      three = this.estimates[statistic];
    return {
      value: three[3 * group],
      low: three[3 * group + 1],
      high: three[3 * group + 2],
      cases: this.casesOf[group],
      failed: this.failedOf[group],
      skipped: this.skippedOf[group],
      rank: this.ranksOf[group] || null,
    };
  }

  cost(setting, completer) {
    const at = setting * this.completers.length + completer;
    return { seconds: this.seconds[at], memory: this.memory[at] };
  }

  /** The quantiles of a group at evenly spread shares, the least and the greatest too; null where there is none. */
  curve(setting, metric, completer) {
    const steps = this.curve_steps + 1,
      start = this.group(setting, metric, completer) * steps;
    const found = this.curves.subarray(start, start + steps);
    return Number.isNaN(found[0]) ? null : found;
  }

  casesIn(setting) {
    return this.casesOf_[setting];
  }

  value(metric, which, completer) {
    return this.values[(metric * this.caseSetting.length + which) * this.completers.length + completer];
  }

  secondsOf(which, completer) {
    return this.caseSeconds[which * this.completers.length + completer];
  }

  /** The row of a case, completer and task: its status, the beginning of its key, and why it has no numbers. */
  row(which, completer, task) {
    const at = (which * this.completers.length + completer) * this.tasks.length + task;
    const key = [...this.keys.subarray(8 * at, 8 * at + 8)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    return { status: this.statuses[at], key, reason: this.reasons[this.rowReasons[at] - 1] ?? "" };
  }

  /** All samples of a case, or null where the page does not hold those of this metric. */
  samples(metric, which, completer) {
    if (!this.samples_of[metric]) return null;
    if (!this.unpacked.has(metric)) {
      const { counts, values } = this.samples_of[metric],
        sizes = shortsOf(counts),
        starts = new Uint32Array(sizes.length + 1);
      for (let i = 0; i < sizes.length; i++) starts[i + 1] = starts[i] + sizes[i];
      this.unpacked.set(metric, { starts, values: shortFloatsOf(values) });
    }
    const { starts, values } = this.unpacked.get(metric),
      at = which * this.completers.length + completer;
    return values.subarray(starts[at], starts[at + 1]);
  }

  settingOf(dataset, incompleteness, level) {
    return this.settings.findIndex(
      (its) => its.dataset === dataset && its.incompleteness === incompleteness && its.level === level,
    );
  }

  /** The settings that differ from this one in their level alone, by level. */
  levelsBeside(setting) {
    const { dataset, incompleteness } = this.settings[setting];
    return this.settings
      .map((_, i) => i)
      .filter((i) => this.settings[i].dataset === dataset && this.settings[i].incompleteness === incompleteness)
      .sort((a, b) => this.settings[a].level - this.settings[b].level);
  }

  levelText(setting) {
    const { level, missing } = this.settings[setting];
    if (level) return `${+(100 * level).toPrecision(3)} %`;
    return missing === null ? "as measured" : `about ${percent(missing)}`;
  }

  metricsOf(task) {
    return this.metrics.map((_, i) => i).filter((i) => this.metrics[i].task === task);
  }

  mainMetric(task) {
    const its = this.metricsOf(task);
    return its.find((i) => this.metrics[i].main) ?? its[0];
  }

  /** The scene of a case, and what else tells it from the others of the board. */
  caseText(which) {
    const draw = this.drawsVary() ? ` · draw ${this.caseDraw[which]}` : "";
    return (
      this.scenes[this.caseScene[which]] +
      draw +
      (this.seeds.length > 1 ? ` · seed ${this.seeds[this.caseSeed[which]]}` : "")
    );
  }

  drawsVary() {
    return (this.varying ??= this.caseDraw.some((draw) => draw !== this.caseDraw[0]));
  }

  /** The class of a completer's colour, the dashes of its lines, the shape of its marks; no two share all three. */
  look(completer) {
    const { role } = this.completers[completer],
      place = this.colored.indexOf(completer);
    if (role)
      return { ink: "ink-reference", dash: { truth: "", ceiling: "7 3", floor: "2 3" }[role] ?? "9 2 2 2", shape: 0 };
    return {
      ink: `ink-${place % 7}`,
      dash: ["", "7 3", "2 3"][Math.floor(place / 7) % 3],
      shape: Math.floor(place / 7) % 3,
    };
  }
}
