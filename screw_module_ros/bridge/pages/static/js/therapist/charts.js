// SPDX-License-Identifier: Apache-2.0
// What the robot does: the hand from above (x right, y away) and from the side (y away, z up), with its
// trail, the targets and the workspace allowed; live traces of position and force, by uPlot.

import {
  BLUE, GREEN, INK, LINE, ORANGE, SKY, SOFT, VERMILLION, arrow, diamond, disc, el, fitted, text,
} from "../draw.js";
import { isPlayed, isUnderWay, targetsOf } from "../link.js";
import { PAGE } from "../words.js";

const TRAIL = 240; // points
const PER_NEWTON = 0.005; // length of the force's arrow [m/N]
const VIEWS = [
  { title: PAGE.above, of: ({ x, y }) => [x, y], low: [-0.2, -0.2], high: [0.2, 0.2] },
  { title: PAGE.side, of: ({ y, z }) => [y, z], low: [-0.2, -0.02], high: [0.2, 0.38] },
];

export class Views {
  constructor() {
    this.trail = [];
    this.canvases = VIEWS.map(({ title }) => el("canvas", { role: "img", ariaLabel: title }));
    this.element = el("section", { className: "card hand" }, el("h2", {}, PAGE.hand),
      el("div", { className: "views" }, ...VIEWS.map(({ title }, i) =>
        el("figure", {}, this.canvases[i], el("figcaption", {}, title)))));
  }

  take({ position }) {
    if (position.x === null) return;
    this.trail.push({ ...position, z: position.z ?? 0 });
    if (this.trail.length > TRAIL) this.trail.shift();
  }

  draw(endpoint, state, limits, protocol) {
    VIEWS.forEach((view, i) => this.drawOne(fitted(this.canvases[i]), view, { endpoint, state, limits, protocol }));
  }

  drawOne({ ctx, width, height }, { of, low, high }, { endpoint, state, limits, protocol }) {
    const place = ([a, b]) => [
      ((a - low[0]) / (high[0] - low[0])) * width, (1 - (b - low[1]) / (high[1] - low[1])) * height,
    ];
    if (limits) drawWorkspace(ctx, place, of, limits);
    drawGrid(ctx, place, low, high, width, height);
    if (isUnderWay(state) && !isPlayed(state)) {
      for (const [x, y, z] of targetsOf(protocol, state)) disc(ctx, ...place(of({ x, y, z })), 5, "#fff", SOFT, 2);
      disc(ctx, ...place(of(state.start)), 6, null, INK, 2);
      diamond(ctx, ...place(of(state.target)), Math.max(9, width / 32), ORANGE, INK, 1.5);
    }
    ctx.beginPath();
    for (const point of this.trail) ctx.lineTo(...place(of(point)));
    ctx.strokeStyle = SKY;
    ctx.lineWidth = 2;
    ctx.stroke();
    if (!endpoint || endpoint.position.x === null) return;
    const [x, y] = place(of({ ...endpoint.position, z: endpoint.position.z ?? 0 }));
    const [fx, fy] = of(endpoint.force).map((value) => (value ?? 0) * PER_NEWTON);
    const scale = width / (high[0] - low[0]);
    disc(ctx, x, y, Math.max(8, width / 36), BLUE, "#fff", 2);
    arrow(ctx, x, y, fx * scale, -fy * scale, INK, 2.5);
  }
}

function drawGrid(ctx, place, low, high, width, height) {
  const size = Math.max(11, width / 32);
  ctx.strokeStyle = LINE;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let a = low[0]; a <= high[0] + 1e-9; a += 0.1) {
    const [x] = place([a, 0]);
    ctx.moveTo(x, 0);
    ctx.lineTo(x, height);
  }
  for (let b = Math.ceil(low[1] * 10) / 10; b <= high[1] + 1e-9; b += 0.1) {
    const [, y] = place([0, b]);
    ctx.moveTo(0, y);
    ctx.lineTo(width, y);
    ctx.clearRect(1, y - 1.6 * size, 1.9 * size, 1.2 * size); // the workspace's edge crosses it
    text(ctx, Math.round(100 * b), 2, y - size, size, SOFT, "left", 400);
  }
  ctx.stroke();
}

function drawWorkspace(ctx, place, of, limits) {
  const at = (sign) => of({
    x: sign * limits["wish.half_width"], y: sign * limits["wish.half_depth"],
    z: sign < 0 ? limits["wish.low"] : limits["wish.high"],
  });
  const [[x1, y1], [x2, y2]] = [place(at(-1)), place(at(1))];
  ctx.strokeStyle = SOFT;
  ctx.lineWidth = 2;
  ctx.setLineDash([6, 5]);
  ctx.strokeRect(x1, y2, x2 - x1, y1 - y2);
  ctx.setLineDash([]);
}

// Writes the axis at the end of each trace, one below the other where they meet.
function nameEnds({ ctx, bbox, data, valToPos }) {
  const size = FONT * (window.devicePixelRatio || 1);
  let last = -Infinity;
  PAGE.axes.map(([name], i) => ({ name, value: data[i + 1].at(-1), colour: COLOURS[i] }))
    .filter(({ value }) => typeof value === "number")
    .map((end) => ({ ...end, y: valToPos(end.value, "y", true) }))
    .sort((one, other) => one.y - other.y)
    .forEach(({ name, y, colour }) => {
      last = Math.max(y, last + 0.9 * size);
      text(ctx, name, bbox.left + bbox.width + 0.8 * size, last, size, colour, "center", 700);
    });
}

const SECONDS = 20;
const MOST = 1400; // points
const FONT = 0.85 * parseFloat(getComputedStyle(document.documentElement).fontSize); // [pixel]
const COLOURS = [BLUE, VERMILLION, GREEN];
const DASHES = [[], [8, 4], [2, 3]];
const STYLES = ["solid", "dashed", "dotted"]; // of the keys

export class Traces {
  constructor() {
    this.times = [];
    this.plots = [
      this.plot(PAGE.position, [-20, 40], false),
      this.plot(PAGE.force, [-20, 20], true),
    ];
    const keys = PAGE.axes.map((label, i) => {
      const style = `border-color: ${COLOURS[i]}; border-style: ${STYLES[i]}; border-width: 0`;
      return el("span", { style }, label);
    });
    this.element = el("section", { className: "card traces" },
      el("div", { className: "row" }, el("h2", {}, PAGE.traces), el("p", { className: "keys" }, ...keys)),
      ...this.plots.map(({ box }) => box));
    new ResizeObserver(() => this.resize()).observe(this.element);
    this.first = null;
  }

  // hasTimes: the time stands below this plot, for all.
  plot(title, range, hasTimes) {
    const font = `${FONT}px system-ui, sans-serif`;
    const place = el("div", { className: "plot", role: "img", ariaLabel: title });
    const box = el("div", { className: "trace" }, el("h3", {}, title), place);
    const series = PAGE.axes.map((_, i) => ({ stroke: COLOURS[i], width: 2, dash: DASHES[i] }));
    const options = {
      width: 300, height: 100, series: [{}, ...series], padding: [FONT / 2, 1.6 * FONT, 0, 0],
      scales: {
        x: { time: false },
        y: { range: (_, low, high) => [Math.min(range[0], low ?? 0), Math.max(range[1], high ?? 0)] },
      },
      axes: [{
        font, stroke: INK, size: hasTimes ? 2 * FONT : 0.6 * FONT, ...(hasTimes ? {} : { values: (_, times) => times.map(() => "") }),
      }, { font, size: 3.2 * FONT, stroke: INK }], cursor: { show: false },
      legend: { show: false }, hooks: { draw: [nameEnds] },
    };
    return { box, place, plot: new uPlot(options, [[], [], [], []], place), columns: [[], [], []] };
  }

  resize() {
    for (const { place, plot } of this.plots) {
      if (place.clientWidth > 50) plot.setSize({ width: place.clientWidth, height: place.clientHeight });
    }
  }

  take({ header, position, force }) {
    const now = header.stamp.sec + header.stamp.nanosec * 1e-9;
    this.first ??= now;
    const time = now - this.first;
    if (time <= (this.times.at(-1) ?? -1)) {
      if (time < this.times.at(-1) - 1) this.clear(now); // the robot's time began anew
      return;
    }
    this.times.push(time);
    const values = [[position.x, position.y, position.z].map((v) => (v === null ? null : 100 * v)),
      [force.x, force.y, force.z]];
    this.plots.forEach(({ columns }, p) => columns.forEach((column, i) => column.push(values[p][i])));
    while (this.times.length > MOST || this.times[0] < time - SECONDS) {
      this.times.shift();
      for (const { columns } of this.plots) columns.forEach((column) => column.shift());
    }
  }

  clear(now) {
    this.first = now;
    this.times.length = 0;
    for (const { columns } of this.plots) columns.forEach((column) => { column.length = 0; });
  }

  draw() {
    for (const { plot, columns } of this.plots) plot.setData([this.times, ...columns]);
  }
}
