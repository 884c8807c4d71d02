// SPDX-License-Identifier: Apache-2.0
// The elevator: the hand is the car, the target the floor where somebody waits.

import { BLUE, GREEN, INK, LINE, ORANGE, SKY, SOFT, VERMILLION } from "../colours.js";
import { disc, line, text, tick } from "../shapes.js";
import { OVER_TIME, PREPARE, REACHED } from "../states.js";

const LOW = 0.0, HIGH = 0.36; // [m] of travel

export function drawElevator({ ctx, width, height }, world) {
  const top = 0.15 * height, bottom = height - Math.max(0.07 * height, 96);
  const at = (z) => bottom - ((z - LOW) / (HIGH - LOW)) * (bottom - top);
  const shaft = Math.min(0.34 * width, 0.32 * height);
  const left = width / 2 - shaft / 2;
  ctx.fillStyle = "#ffffff";
  ctx.fillRect(left, top, shaft, bottom - top);
  for (let z = LOW; z <= HIGH + 1e-6; z += 0.06) line(ctx, left, at(z), left + shaft, at(z), LINE, 2);
  ctx.strokeStyle = SOFT;
  ctx.lineWidth = 4;
  ctx.strokeRect(left, top, shaft, bottom - top);
  const { state, hand } = world;
  const goal = state.phase === PREPARE ? state.start : state.target;
  const half = Math.max(0.1 * shaft, at(0) - at(state.hit_radius || 0.01));
  drawFloor(ctx, left, shaft, at(goal.z), half, state);
  if (hand.z !== null) drawCar(ctx, left + 0.2 * shaft, at(hand.z), 0.6 * shaft, half, at(HIGH));
}

function drawFloor(ctx, left, shaft, y, half, state) {
  const reached = state.phase === REACHED;
  const colour = reached ? GREEN : state.phase === PREPARE ? SKY : ORANGE;
  ctx.globalAlpha = 0.35;
  ctx.fillStyle = colour;
  ctx.fillRect(left, y - half, shaft, 2 * half);
  ctx.globalAlpha = 1;
  line(ctx, left, y - half, left + shaft, y - half, colour, 4);
  line(ctx, left, y + half, left + shaft, y + half, colour, 4);
  const x = left + shaft + 1.6 * half;
  if (reached) {
    disc(ctx, x, y, half, GREEN);
    tick(ctx, x, y, half, "#ffffff");
  } else {
    drawPerson(ctx, x, y, half, state.phase === OVER_TIME ? VERMILLION : INK);
    if (state.phase === PREPARE) text(ctx, "start", x + 2.2 * half, y, 0.9 * half, INK, "left");
  }
}

function drawPerson(ctx, x, y, size, colour) {
  disc(ctx, x, y - 0.55 * size, 0.32 * size, colour);
  ctx.beginPath();
  ctx.moveTo(x, y - 0.2 * size);
  ctx.lineTo(x + 0.5 * size, y + 0.95 * size);
  ctx.lineTo(x - 0.5 * size, y + 0.95 * size);
  ctx.closePath();
  ctx.fillStyle = colour;
  ctx.fill();
}

function drawCar(ctx, x, y, width, half, top) {
  line(ctx, x + width / 2, top, x + width / 2, y - half, SOFT, 4);
  ctx.fillStyle = BLUE;
  ctx.beginPath();
  ctx.roundRect(x, y - half, width, 2 * half, 0.4 * half);
  ctx.fill();
  line(ctx, x + width / 2, y - 0.7 * half, x + width / 2, y + 0.7 * half, "#ffffff", 3);
  line(ctx, x + 0.12 * width, y, x + 0.88 * width, y, "#ffffff", 3);
}
