// The plots beside the scene, on one time axis. Limits are dashed; the vertical line is the row that is shown.

import {colour} from "theme";

const WINDOW = 6; // s, of a live walk
const MOST_POINTS = 1200; // of a curve
const LEAST_V = 1e-6;
const PANELS = [
  {title: "V, its bound", columns: ["V", "V_bound"], log: true},
  {title: "barriers B", columns: (about) => about.barriers, limits: () => [0]},
  {title: "|F_T| / F_N", columns: ["force_ratio"], limits: (about) => [about.friction_coeff]},
  {title: "torque (N m)", columns: (about) => about.columns.filter((name) => name.startsWith("torque_")),
    limits: (about) => [-about.torque_limit, about.torque_limit]},
  {title: "slack d, of last resort", columns: ["clf_slack", "rescue_slack"]},
  {title: "what a row leaves", of: "row", columns: ["margin"], limits: () => [0]},
  {title: "model error", of: "quantity", columns: ["measured", "estimated", "true"]},
];
const OUTLIERS = 0.02; // share of the numbers at either end that the axis of `of` need not show
const DASHES = [[], [6, 3], [2, 3], [8, 3, 2, 3]];
const WORDS = {V_bound: "bound", clf_slack: "d", rescue_slack: "last resort", force_ratio: "ratio"};

export class Plots {
  constructor(section, clock) {
    this.clock = clock;
    this.which = section.querySelector("#which");
    this.panels = section.querySelector("#panels");
    this.chosen = 0;
    this.of = {row: 0, quantity: 0}; // chosen
    this.plots = [];
    new ResizeObserver(() => this.resize()).observe(this.panels);
  }

  begin(walk) {
    this.walk = walk;
    this.chosen = Math.min(this.chosen, walk.walkers.length - 1);
    this.build();
  }

  get walker() {
    return this.walk.walkers[this.chosen];
  }

  build() {
    for (const {plot} of this.plots) plot.destroy();
    this.panels.replaceChildren();
    this.chooser();
    const {about} = this.walker, of = (value) => (value?.call ? value(about) : value);
    const panels = (about.panels ?? PANELS).map((panel) => ({...panel, columns: of(panel.columns), limits: of(panel.limits) ?? []}));
    const wanted = panels.filter((panel) => panel.of ? this.names(panel).length : panel.columns.some((name) => this.walker.has(name)));
    this.plots = wanted.map((panel, i) => this.panel(panel, i === wanted.length - 1, wanted.findIndex(({of}) => of === panel.of) === i));
    this.draw();
  }

  chooser() {
    const buttons = this.walk.walkers.map((walker, i) => {
      const button = Object.assign(document.createElement("button"), {textContent: `plots: ${walker.about.name}`});
      button.setAttribute("aria-pressed", i === this.chosen);
      button.onclick = () => { this.chosen = i; this.build(); };
      return button;
    });
    this.which.replaceChildren(...(buttons.length > 1 ? buttons : []));
  }

  // what the panel is of one of: quantities, or rows of the QP
  names({of}) {
    if (of === "quantity") return this.walker.about.quantities;
    return this.walker.about.columns.filter((name) => name.startsWith("margin_")).map((name) => name.slice(7));
  }

  // `chooses`: the first panel of one of several has their names
  panel(panel, isLast, chooses) {
    const names_of = panel.of ? this.names(panel) : [], name = names_of[Math.min(this.of[panel.of], names_of.length - 1)];
    if (panel.of) panel = {...panel, columns: panel.columns.filter((kind) => this.walker.has(`${kind}_${name}`))};
    const box = Object.assign(document.createElement("div"), {className: "panel"});
    const title = Object.assign(document.createElement("h2"), {textContent: panel.title});
    const names = panel.columns.map((name, i) => {
      const label = document.createElement("b"), line = document.createElement("i");
      line.style.borderTopStyle = i ? "dashed" : "solid";
      line.style.borderTopColor = `var(--${hue(i)})`;
      label.append(line, WORDS[name] ?? name.replace(/^(torque|u|x|slack)_/, "").replace("_", " "));
      return label;
    });
    title.append(...(panel.of && chooses ? [this.chooserOf(panel, names_of), ...names] : names));
    box.append(title);
    this.panels.append(box);
    const columns = panel.of ? panel.columns.map((kind) => `${kind}_${name}`) : panel.columns;
    const limits = panel.limits.filter(Number.isFinite);
    const plot = new uPlot(this.options(panel, columns, limits, isLast), columns.map(() => []).concat([[]]), box);
    plot.over.addEventListener("click", () => this.clock.seek(this.clock.rowAt(plot.posToVal(plot.cursor.left, "x"))));
    return {plot, columns, panel};
  }

  chooserOf({of}, names) {
    const select = document.createElement("select");
    select.id = of;
    select.setAttribute("aria-label", of);
    select.append(...names.map((name, i) => new Option(name, i, false, i === this.of[of])));
    select.onchange = () => { this.of[of] = Number(select.value); this.build(); };
    return select;
  }

  options(panel, columns, limits, isLast) {
    const axis = {stroke: () => colour("faint"), grid: {stroke: () => colour("line"), width: 0.5}, ticks: {show: false}, font: "10px system-ui"};
    return {
      width: this.width, height: isLast ? 112 : 92, padding: [6, 8, 0, 0], legend: {show: false},
      cursor: {sync: {key: "rabbit"}, y: false, drag: {x: false, y: false}, points: {show: false}},
      scales: {
        x: {time: false, range: () => this.window()},
        y: panel.log ? {distr: 3, range: (_, low, high) => logarithmic(low, high)} : {range: (plot, low, high) => linear(...(panel.of ? usual(plot.data) : [low, high]), limits)},
      },
      axes: [
        {...axis, size: isLast ? 22 : 4, values: isLast ? (_, ticks) => ticks.map((tick) => `${tick} s`) : () => []},
        {...axis, size: 46, ...(panel.log && {grid: {...axis.grid, filter: decades}, values: (_, ticks) => ticks.map((tick) => (tick >= 0.001 ? tick : tick?.toExponential(0)))})},
      ],
      series: [{}, ...columns.map((_, i) => ({stroke: () => colour(hue(i)), width: columns[i].startsWith("active_") ? 5 : 1.3, dash: DASHES[i % 4], points: {show: false}, spanGaps: false}))],
      hooks: {draw: [(plot) => this.lines(plot, limits)]},
    };
  }

  get width() {
    return Math.max(this.panels.clientWidth - 8, 120);
  }

  resize() {
    for (const {plot} of this.plots) plot.setSize({width: this.width, height: plot.height});
  }

  window() {
    if (!this.walk.length) return [0, WINDOW];
    const end = this.walk.time(this.walk.length - 1);
    if (!this.clock.isLive) return [0, Math.max(end, 0.1)];
    const to = this.clock.isFollowing ? this.clock.at : Math.min(end, Math.max(this.clock.at + WINDOW / 2, WINDOW));
    return [Math.max(to - WINDOW, 0), Math.max(to, WINDOW)];
  }

  draw() {
    if (!this.walk?.length) return;
    const [from, to] = this.window();
    const first = this.clock.rowAt(from), last = this.clock.rowAt(to);
    const stride = Math.ceil((last - first + 1) / MOST_POINTS);
    const rows = Array.from({length: Math.floor((last - first) / stride) + 1}, (_, i) => first + i * stride);
    const times = rows.map((row) => this.walk.time(row));
    for (const {plot, columns, panel} of this.plots) {
      const curves = columns.map((name) => rows.map((row) => {
        const value = this.walker.get(row, name);
        return !Number.isFinite(value) ? null : panel.log ? Math.max(value, LEAST_V) : value;
      }));
      plot.setData([times, ...curves]);
    }
  }

  lines(plot, limits) {
    const {ctx, bbox} = plot;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    ctx.strokeStyle = colour("limit");
    ctx.setLineDash([6, 4]);
    for (const limit of limits) {
      const y = plot.valToPos(limit, "y", true);
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    if (!this.clock.isFollowing) {
      const x = plot.valToPos(this.clock.at, "x", true);
      ctx.setLineDash([]);
      ctx.strokeStyle = colour("text");
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }
}

const hue = (i) => `plot${(i % 4) + 1}`;

// least and greatest of what is drawn, but for outliers: a few impacts would make all else a flat line
function usual([, ...curves]) {
  const values = curves.flat().filter((value) => value !== null).sort((one, other) => one - other);
  if (!values.length) return [null, null];
  const out = Math.floor(values.length * OUTLIERS);
  return [values[out], values[values.length - 1 - out]];
}

function linear(low, high, limits) {
  if (low === null) [low, high] = [0, 1];
  low = Math.min(low, ...limits);
  high = Math.max(high, ...limits);
  const margin = (high - low || 1) * 0.06;
  return [low - margin, high + margin];
}

function decades(_, values) {
  return values.map((value) => (Number.isInteger(Math.round(Math.log10(value) * 1e6) / 1e6) ? value : null));
}

function logarithmic(low, high) {
  if (low === null) return [0.01, 1];
  return [10 ** Math.floor(Math.log10(low)), 10 ** Math.ceil(Math.log10(high) + 1e-9)];
}
