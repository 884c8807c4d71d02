// SPDX-License-Identifier: Apache-2.0
// The fruit: each kind has a colour and a shape of its own.

import { GREEN, INK, ORANGE, PURPLE, VERMILLION, YELLOW } from "../colours.js";
import { disc } from "../shapes.js";

export const KINDS = {
  apple: { colour: VERMILLION, worth: 1, shape: apple },
  pear: { colour: GREEN, worth: 1, shape: pear },
  plum: { colour: PURPLE, worth: 1, shape: plum },
  lemon: { colour: YELLOW, worth: 1, shape: lemon },
  golden: { colour: ORANGE, worth: 3, shape: star },
};

export function drawFruit(ctx, kind, x, y, radius) {
  kind.shape(ctx, x, y, radius, kind.colour);
}

function stalk(ctx, x, y, radius) {
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.12 * radius;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.quadraticCurveTo(x, y - 0.3 * radius, x + 0.25 * radius, y - 0.45 * radius);
  ctx.stroke();
}

function apple(ctx, x, y, radius, colour) {
  disc(ctx, x - 0.35 * radius, y, 0.75 * radius, colour);
  disc(ctx, x + 0.35 * radius, y, 0.75 * radius, colour);
  stalk(ctx, x, y - 0.6 * radius, radius);
}

function pear(ctx, x, y, radius, colour) {
  disc(ctx, x, y + 0.25 * radius, 0.75 * radius, colour);
  disc(ctx, x, y - 0.45 * radius, 0.45 * radius, colour);
  stalk(ctx, x, y - 0.85 * radius, radius);
}

function plum(ctx, x, y, radius, colour) {
  ctx.fillStyle = colour;
  ctx.beginPath();
  ctx.ellipse(x, y, 0.95 * radius, 0.65 * radius, 0.5, 0, 2 * Math.PI);
  ctx.fill();
  stalk(ctx, x + 0.1 * radius, y - 0.6 * radius, radius);
}

function lemon(ctx, x, y, radius, colour) {
  ctx.fillStyle = colour;
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.06 * radius;
  ctx.beginPath();
  ctx.moveTo(x - 1.05 * radius, y);
  ctx.quadraticCurveTo(x, y - 1.25 * radius, x + 1.05 * radius, y);
  ctx.quadraticCurveTo(x, y + 1.25 * radius, x - 1.05 * radius, y);
  ctx.fill();
  ctx.stroke();
}

function star(ctx, x, y, radius, colour) {
  ctx.fillStyle = colour;
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.08 * radius;
  ctx.beginPath();
  for (let i = 0; i < 10; i++) {
    const [r, angle] = [(i % 2 ? 0.5 : 1.1) * radius, (Math.PI * i) / 5 - Math.PI / 2];
    ctx.lineTo(x + r * Math.cos(angle), y + r * Math.sin(angle));
  }
  ctx.closePath();
  ctx.fill();
  ctx.stroke();
}
