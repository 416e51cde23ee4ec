// Puts the page together: controls, legend, and everything that is drawn again when the reader chooses something.

function start() {
  const board = new Board(JSON.parse(document.getElementById("board").textContent)),
    note = new Note();
  const choice = new Choice(board, () => draw());
  const lit = (completer) => {
    document.body.classList.toggle("has-lit", completer !== null);
    for (const element of document.querySelectorAll(".lit")) element.classList.remove("lit");
    if (completer !== null)
      for (const element of document.querySelectorAll(`[data-completer='${completer}']`)) element.classList.add("lit");
  };
  const tables = new Tables(board, choice, lit),
    figures = new Figures(board, choice, note, lit);
  const rows = new Rows(board, choice),
    one = new OneCase(board, choice);
  connectSelects(board, choice);

  const drawn = {};
  /** Whether what a part shows has changed since it was drawn. */
  const changed = (part, ...shows) => {
    const text = JSON.stringify(shows),
      before = drawn[part];
    drawn[part] = text;
    return before !== text;
  };

  function draw() {
    const focused = document.activeElement?.dataset.sort,
      { setting, task, metric, statistic, sort } = choice,
      hidden = [...choice.hidden];
    document.body.dataset.view = task === null ? "overview" : "task";
    drawControls(board, choice);
    if (changed("table", setting, task, metric, statistic, sort, hidden)) tables.draw();
    if (changed("figures", setting, metric, statistic, hidden)) figures.draw();
    if (changed("cases", setting)) one.drawChoice();
    if (changed("case", one.which, hidden)) one.draw();
    if (changed("rows", setting, metric, choice.open, choice.case)) rows.draw();
    if (focused) [...document.querySelectorAll("[data-sort]")].find((its) => its.dataset.sort === focused)?.focus();
  }

  let width = innerWidth;
  window.addEventListener("resize", () => {
    if (innerWidth !== width) {
      width = innerWidth;
      figures.draw();
    }
  });
  window.addEventListener("beforeprint", () => figures.draw());
  draw();
}

function drawControls(board, choice) {
  const here = board.settings[choice.setting],
    unique = (values) => [...new Set(values)];
  radios(
    "task",
    "Task",
    [["", "All tasks"], ...board.tasks.map((its, i) => [i, its.name])],
    choice.task ?? "",
    (value) =>
      choice.set(
        value === ""
          ? { task: null, metric: null, open: null, sort: "" }
          : { task: Number(value), metric: board.mainMetric(Number(value)), sort: "" },
      ),
  );
  const levels = board.levelsBeside(choice.setting);
  radios(
    "level",
    "Missing",
    levels.map((i) => [i, board.levelText(i)]),
    choice.setting,
    (value) => choice.set({ setting: Number(value) }),
  );
  const ways = unique(board.settings.filter((its) => its.dataset === here.dataset).map((its) => its.incompleteness));
  radios(
    "incompleteness",
    "Taken away by",
    ways.map((i) => [i, board.incompletenesses[i]]),
    here.incompleteness,
    (value) => choice.set({ setting: choice.nearest(here.dataset, Number(value), here.level) }),
  );
  radios(
    "data",
    "Data set",
    board.datasets.map((its, i) => [i, its.label]),
    here.dataset,
    (value) => choice.set({ setting: choice.nearest(Number(value), here.incompleteness, here.level) }),
  );
  const metric = document.querySelector("[data-choice='metric']");
  metric.closest("label").hidden = choice.metric === null;
  if (choice.metric !== null)
    metric.replaceChildren(
      ...board
        .metricsOf(choice.task)
        .map((i) => el("option", { value: i, selected: i === choice.metric }, board.metrics[i].name)),
    );
  const statistic = document.querySelector("[data-choice='statistic']");
  const own =
    choice.metric === null ? "each metric's own" : `${STATISTICS[board.metrics[choice.metric].summary]} (its own)`;
  statistic.replaceChildren(
    ...[["", own], ...Object.entries(STATISTICS)].map(([value, text]) =>
      el("option", { value, selected: (choice.statistic ?? "") === value }, text),
    ),
  );
  drawLegend(board, choice);
}

/** Radio buttons, made anew only when what they offer has changed: they must not lose the keyboard's focus. */
function radios(name, label, options, chosen, pick) {
  const place = document.querySelector(`[data-choice='${name}']`),
    signature = JSON.stringify(options);
  place.hidden = options.length < 2;
  if (place.dataset.options !== signature) {
    place.dataset.options = signature;
    place.replaceChildren(
      el("legend", {}, label),
      el(
        "div",
        { class: "radios" },
        options.map(([value, text]) =>
          el(
            "label",
            {},
            el("input", {
              type: "radio",
              name,
              value,
              autocomplete: "off",
              change: (event) => place.pick(event.target.value),
            }),
            isolated(text),
          ),
        ),
      ),
    );
  }
  place.pick = pick;
  for (const input of place.querySelectorAll("input")) input.checked = input.value === String(chosen);
}

function connectSelects(board, choice) {
  const on = (name, change) =>
    document
      .querySelector(`[data-choice='${name}']`)
      .addEventListener("change", (event) => choice.set(change(event.target.value)));
  on("metric", (value) => ({ metric: Number(value) }));
  on("statistic", (value) => ({ statistic: value || null }));
  document.querySelector("[data-choice='everyone']").addEventListener("click", () => choice.set({ hidden: new Set() }));
}

function drawLegend(board, choice) {
  const place = document.querySelector("[data-place='legend']");
  if (!place.children.length) {
    place.append(
      ...board.completers.map((its, completer) =>
        el(
          "button",
          {
            type: "button",
            "data-completer": completer,
            "data-toggles": completer,
            click: () => {
              const hidden = new Set(choice.hidden);
              if (!hidden.delete(completer)) hidden.add(completer);
              choice.set({ hidden });
            },
          },
          swatch(board.look(completer)),
          isolated(its.name),
        ),
      ),
    );
  }
  for (const button of place.children)
    button.setAttribute("aria-pressed", String(!choice.hidden.has(Number(button.dataset.toggles))));
  document.querySelector("[data-choice='everyone']").hidden = !choice.hidden.size;
}

start();
