// SPDX-License-Identifier: Apache-2.0
// The workspace seen from behind and above the patient's head: x right, y away, z up [m].

const EYE = [0, -0.78, 0.62];
const AT = [0, 0.02, 0.15];
const FLOOR = 0.0;

const minus = (a, b) => a.map((value, i) => value - b[i]);
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
const unit = (a) => a.map((value) => value / Math.hypot(...a));
const FORWARD = unit(minus(AT, EYE));
const RIGHT = [1, 0, 0];
const UP = [
  RIGHT[1] * FORWARD[2] - RIGHT[2] * FORWARD[1],
  RIGHT[2] * FORWARD[0] - RIGHT[0] * FORWARD[2],
  RIGHT[0] * FORWARD[1] - RIGHT[1] * FORWARD[0],
];

// Returns how to show the workspace in a picture of this size.
export function camera(width, height) {
  const focus = 1.75 * Math.min(width * 1.15, height);
  return { cx: width / 2, cy: 0.52 * height, focus };
}

// Returns { x, y, scale }: where a point is in the picture, and pixels per metre there.
export function seen(view, point) {
  const from = minus(point, EYE);
  const scale = view.focus / dot(from, FORWARD);
  return { x: view.cx + scale * dot(from, RIGHT), y: view.cy - scale * dot(from, UP), scale };
}

export function onFloor([x, y]) {
  return [x, y, FLOOR];
}

// Draws the floor with its grid.
export function drawFloor(ctx, view, colour, edge) {
  const corners = [[-0.19, -0.17], [0.19, -0.17], [0.19, 0.19], [-0.19, 0.19]];
  ctx.beginPath();
  corners.map((corner) => seen(view, onFloor(corner))).forEach(({ x, y }) => ctx.lineTo(x, y));
  ctx.closePath();
  ctx.fillStyle = colour;
  ctx.fill();
  ctx.strokeStyle = edge;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  for (let i = 0; i <= 6; i++) {
    const [x, y] = [-0.19 + (i * 0.38) / 6, -0.17 + (i * 0.36) / 6];
    for (const [a, b] of [[[x, -0.17], [x, 0.19]], [[-0.19, y], [0.19, y]]]) {
      const [from, to] = [seen(view, onFloor(a)), seen(view, onFloor(b))];
      ctx.moveTo(from.x, from.y);
      ctx.lineTo(to.x, to.y);
    }
  }
  ctx.stroke();
}

// Draws a stem from a point to the floor, with a shadow there: how deep it lies is seen by these.
export function drawStem(ctx, view, point, radius, colour) {
  const [top, foot] = [seen(view, point), seen(view, onFloor(point))];
  ctx.strokeStyle = colour;
  ctx.lineWidth = Math.max(2, 0.0016 * view.focus); // a large screen is seen from farther away
  ctx.setLineDash([3 * ctx.lineWidth, 3 * ctx.lineWidth]);
  ctx.beginPath();
  ctx.moveTo(top.x, top.y);
  ctx.lineTo(foot.x, foot.y);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.globalAlpha = 0.35;
  ctx.fillStyle = colour;
  ctx.beginPath();
  ctx.ellipse(foot.x, foot.y, radius * foot.scale, 0.55 * radius * foot.scale, 0, 0, 2 * Math.PI);
  ctx.fill();
  ctx.globalAlpha = 1;
}
