// SPDX-License-Identifier: Apache-2.0
// The hand from above (x right, y away) and from the side (y away, z up), with its trail, the
// targets and the workspace allowed.

import { fitted } from "../canvas.js";
import { BLUE, INK, LINE, ORANGE, SKY, SOFT } from "../colours.js";
import { el } from "../elements.js";
import { arrow, diamond, disc, text } from "../shapes.js";
import { PAUSED, RUNNING, targetsOf } from "../states.js";

const TRAIL = 240; // points
const PER_NEWTON = 0.002; // length of the force's arrow [m/N]
const VIEWS = [
  { title: "From above: away from the patient is up", of: ({ x, y }) => [x, y], low: [-0.2, -0.2], high: [0.2, 0.2] },
  { title: "From the side: away from the patient is right", of: ({ y, z }) => [y, z], low: [-0.2, -0.02], high: [0.2, 0.38] },
];

export class Views {
  constructor() {
    this.trail = [];
    this.canvases = VIEWS.map(({ title }) => el("canvas", { ariaLabel: title }));
    this.element = el("section", { className: "card" }, el("h2", {}, "Hand"),
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
    drawGrid(ctx, place, low, high, width, height);
    if (limits) drawWorkspace(ctx, place, of, limits);
    const inSession = state && (state.state === RUNNING || state.state === PAUSED);
    if (inSession) {
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
    arrow(ctx, x, y, fx * scale, -fy * scale, INK, 2.5);
    disc(ctx, x, y, Math.max(8, width / 36), BLUE, "#fff", 2);
  }
}

function drawGrid(ctx, place, low, high, width, height) {
  const size = Math.max(10, width / 32);
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
    text(ctx, `${Math.round(100 * b)} cm`, 4, y - size, size, SOFT, "left", 400);
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
