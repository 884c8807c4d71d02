// SPDX-License-Identifier: Apache-2.0
// One line of a patient's progress over weeks: the first session hollow, the error of measurement grey.

import { firstAndLatest, plotted, weekWords } from "../cells.js";
import { BLUE, LINE, SOFT, disc, el, fitted, line, text } from "../draw.js";
import { said } from "../language.js";

const LEFT = 34, EDGE = 8, LOW = 14, DOT = 3.5, SIZE = 10;

export class LineCard {
  // found: a line of the bridge; weeks: when its points were measured.
  constructor(found, weeks) {
    this.found = found;
    this.weeks = weeks;
    this.shown = found.points.map((point, n) => ({ ...point, week: weeks[n] })).filter(({ value }) => value !== null);
    this.canvas = el("canvas", { role: "img", ariaLabel: plotted(found), hidden: !this.shown.length });
    this.element = el("figure", { className: "line" }, el("h3", {}, said(found.label)), this.canvas,
      el("p", { className: "latest" }, firstAndLatest(found)),
      ...[found.slope, found.change].filter(Boolean).map((words) => el("p", {}, said(words))));
  }

  draw() {
    const { shown } = this;
    if (!shown.length) return;
    const { ctx, width, height } = fitted(this.canvas);
    const base = this.found.base === null ? null : this.found.points[this.found.base].value;
    const band = base === null ? [] : [-1, 1].map((sign) => base + sign * this.found.error * Math.abs(base));
    const values = [...band, ...shown.flatMap(({ value, low, high }) => [value, low ?? value, high ?? value])];
    const [least, most] = [Math.min(...values), Math.max(...values)];
    const last = Math.max(...this.weeks, 1e-9);
    const x = (week) => LEFT + EDGE + ((width - LEFT - 2 * EDGE) * week) / last;
    const y = (value) => (most > least ? EDGE + ((height - LOW - 2 * EDGE) * (most - value)) / (most - least) : (height - LOW) / 2);
    if (band.length) {
      ctx.fillStyle = "#dfe2e4";
      ctx.fillRect(LEFT, y(band[1]), width - LEFT, y(band[0]) - y(band[1]));
    }
    line(ctx, LEFT, height - LOW, width, height - LOW, LINE, 1);
    line(ctx, LEFT, 0, LEFT, height - LOW, LINE, 1);
    for (const value of new Set([least, most])) text(ctx, value.toPrecision(3), LEFT - 3, y(value), SIZE, SOFT, "right", 400);
    text(ctx, weekWords(last), width - EDGE, height - LOW / 2, SIZE, SOFT, "right", 400);
    text(ctx, "0", x(0), height - LOW / 2, SIZE, SOFT, "center", 400);
    for (const [n, { value, low, high, week }] of shown.entries()) {
      if (low !== null) line(ctx, x(week), y(low), x(week), y(high), SOFT, 2);
      disc(ctx, x(week), y(value), DOT, n ? BLUE : "#ffffff", BLUE, 1.5);
    }
  }
}
