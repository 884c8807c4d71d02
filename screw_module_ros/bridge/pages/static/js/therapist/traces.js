// SPDX-License-Identifier: Apache-2.0
// Live traces of position and force over the last seconds, by uPlot.

import { BLUE, GREEN, VERMILLION } from "../colours.js";
import { el } from "../elements.js";

const SECONDS = 20;
const MOST = 1400; // points
const FONT = 0.85 * parseFloat(getComputedStyle(document.documentElement).fontSize); // [pixel]
const COLOURS = [BLUE, VERMILLION, GREEN];
const DASHES = [[], [8, 4], [2, 3]];

export class Traces {
  constructor() {
    this.times = [];
    this.plots = [
      this.plot("Position [cm] over time [s]", ["x right", "y away", "z up"], [-20, 40]),
      this.plot("Force of the patient on the robot [N] over time [s]", ["x right", "y away", "z up"], [-20, 20]),
    ];
    this.element = el("section", { className: "card" }, el("h2", {}, "Traces"),
      ...this.plots.map(({ box }) => box));
    new ResizeObserver(() => this.resize()).observe(this.element);
    this.first = null;
  }

  plot(title, names, range) {
    const font = `${FONT}px system-ui, sans-serif`;
    const box = el("div", { className: "trace" }, el("h3", {}, title));
    const series = names.map((label, i) => ({
      label, stroke: COLOURS[i], width: 2, dash: DASHES[i], value: (_, v) => v?.toFixed(1) ?? "–",
    }));
    const options = {
      width: 300, height: 11 * FONT, series: [{ label: "s", value: (_, v) => v?.toFixed(1) ?? "–" }, ...series],
      scales: {
        x: { time: false },
        y: { range: (_, low, high) => [Math.min(range[0], low ?? 0), Math.max(range[1], high ?? 0)] },
      },
      axes: [{ font, size: 2.2 * FONT }, { font, size: 3.6 * FONT }], cursor: { show: false },
      legend: { live: false },
    };
    return { box, plot: new uPlot(options, [[], [], [], []], box), columns: [[], [], []] };
  }

  resize() {
    const width = this.element.clientWidth - 32;
    if (width > 50) for (const { plot } of this.plots) plot.setSize({ width, height: 11 * FONT });
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
