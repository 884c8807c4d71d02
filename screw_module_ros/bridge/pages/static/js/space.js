// SPDX-License-Identifier: Apache-2.0
// The workspace seen from behind and above the patient's head: x right, y away, z up [m].

import { arrow, line } from "./draw.js";

const EYE = [0, -0.78, 0.62];
const AT = [0, 0.02, 0.15];
const FLOOR = 0.0;
export const RADIUS = 0.03; // of hand and target, to be seen from two metres [m]

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

const LEFT = -0.19, NEAR = -0.17, ROWS = 6, SQUARE = 0.38 / ROWS; // of the floor [m]

// Draws the floor, a chequered board: rows that get narrower show what is far away.
export function drawFloor(ctx, view, light, dark) {
  for (let i = 0; i < ROWS; i++) {
    for (let j = 0; j < ROWS; j++) {
      const [x, y] = [LEFT + i * SQUARE, NEAR + j * SQUARE];
      ctx.beginPath();
      for (const [dx, dy] of [[0, 0], [1, 0], [1, 1], [0, 1]]) {
        const corner = seen(view, onFloor([x + dx * SQUARE, y + dy * SQUARE]));
        ctx.lineTo(corner.x, corner.y);
      }
      ctx.fillStyle = (i + j) % 2 ? light : dark;
      ctx.fill();
    }
  }
}

// Draws the post on which a point stands, with its foot on the floor: where the foot stands is how far
// away the point is, the post's length how high.
export function drawPost(ctx, view, point, radius, colour) {
  const [top, foot] = [seen(view, point), seen(view, onFloor(point))];
  const width = 0.006 * foot.scale; // a large screen is seen from farther away
  for (const [fill, more] of [["#ffffff", 1], [colour, 0]]) {
    ctx.fillStyle = fill;
    ctx.beginPath();
    ctx.ellipse(foot.x, foot.y, radius * foot.scale + more * 3, 0.5 * radius * foot.scale + more * 3, 0, 0, 2 * Math.PI);
    ctx.fill();
    line(ctx, top.x, top.y, foot.x, foot.y, fill, width + more * 4);
  }
}

const LEAST_WAY = 0.03; // on the floor, below which no arrow shows it [m]

// Draws on the floor which way a hand has to go to be at a goal, in front of it or behind.
export function drawWay(ctx, view, hand, goal, colour) {
  if (Math.hypot(goal[0] - hand[0], goal[1] - hand[1]) < LEAST_WAY) return;
  const [from, to] = [seen(view, onFloor(hand)), seen(view, onFloor(goal))];
  arrow(ctx, from.x, from.y, to.x - from.x, to.y - from.y, colour, 0.007 * from.scale);
}
