// SPDX-License-Identifier: Apache-2.0
// The pictures of a session. The clock: targets round a centre, seen from above; away from the patient is
// up. The elevator: the hand is the car, the target the floor where somebody waits. Space: targets as
// lanterns on a shelf, each with a stem and a shadow on the floor.

import {
  BLUE, GREEN, INK, LINE, ORANGE, SKY, SOFT, VERMILLION, arrow, disc, drawGoal, drawHand, line, text, tick,
} from "../draw.js";
import { OVER_TIME, PREPARE, REACHED, targetsOf } from "../link.js";
import { camera, drawFloor, drawStem, seen } from "../space.js";
import { SCREEN } from "../words.js";

// Clock -------------------------------------------------------------------------------------

const HALF = 0.185; // of the workspace that is shown [m]
const LEAST = 20; // radius of a target on the screen, however small its own [pixel]

function drawClock({ ctx, width, height }, world) {
  const scale = (Math.min(width, 0.86 * height) / 2 - 10) / HALF;
  const place = (p) => [width / 2 + scale * p.x, 0.54 * height - scale * p.y];
  const { state, hand, protocol } = world;
  const radius = Math.max(LEAST, scale * (state.hit_radius || 0.01), 0.018 * scale);
  const [cx, cy] = place({ x: 0, y: 0 });
  disc(ctx, cx, cy, 0.165 * scale, "#ffffff", LINE, 3);
  for (const [x, y] of targetsOf(protocol, state)) {
    const [tx, ty] = place({ x, y });
    line(ctx, cx, cy, tx, ty, LINE, 2);
    disc(ctx, tx, ty, radius, "#ffffff", SOFT, 3);
  }
  disc(ctx, cx, cy, radius, "#ffffff", SOFT, 3);
  const goal = state.phase === PREPARE ? state.start : state.target;
  if (state.kind === "circle") drawCircle(ctx, place, state, scale);
  else if (state.kind === "strength") drawPush(ctx, place, state, world.force, scale);
  else drawGoal(ctx, ...place(goal), radius, state);
  if (hand.isKnown) drawHand(ctx, ...place(hand), 0.85 * radius);
}

function drawCircle(ctx, place, state, scale) {
  const [x, y] = place(state.start);
  const radius = Math.hypot(state.target.x - state.start.x, state.target.y - state.start.y);
  disc(ctx, x, y, radius * scale, null, ORANGE, 10);
}

// The push that is asked for, and beside it the one that is felt.
function drawPush(ctx, place, state, force, scale) {
  const [x, y] = place(state.start);
  const dx = state.target.x - state.start.x;
  const dy = state.target.y - state.start.y;
  const length = Math.hypot(dx, dy) || 1;
  const felt = Math.max(0, (force.x * dx + force.y * dy) / length);
  arrow(ctx, x, y, 0.14 * scale * (dx / length), -0.14 * scale * (dy / length), ORANGE, 12);
  const share = Math.min(felt / 40, 1) * 0.14 * scale;
  arrow(ctx, x, y, share * (dx / length), -share * (dy / length), SKY, 8);
  disc(ctx, x, y, 6, INK);
}

// Elevator ----------------------------------------------------------------------------------

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
  drawStorey(ctx, left, shaft, at(goal.z), half, state);
  if (hand.z !== null) drawCar(ctx, left + 0.2 * shaft, at(hand.z), 0.6 * shaft, half, at(HIGH));
}

function drawStorey(ctx, left, shaft, y, half, state) {
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
    if (state.phase === PREPARE) text(ctx, SCREEN.start, x + 2.2 * half, y, 0.9 * half, INK, "left");
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

// Space -------------------------------------------------------------------------------------

const RADIUS = 0.017; // of what is drawn [m]

export function drawSpace({ ctx, width, height }, world) {
  const view = camera(width, height);
  const { state, hand, protocol } = world;
  drawFloor(ctx, view, "#ffffff", LINE);
  for (const target of targetsOf(protocol, state)) {
    const { x, y, scale } = seen(view, target);
    disc(ctx, x, y, RADIUS * scale, "#ffffff", SOFT, 3);
  }
  const goal = state.phase === PREPARE ? state.start : state.target;
  const things = [{ point: [goal.x, goal.y, goal.z], draw: drawTheGoal, colour: ORANGE }];
  if (hand.isKnown) {
    things.push({ point: [hand.x, hand.y, hand.z], draw: drawTheHand, colour: BLUE });
  }
  things.sort((one, other) => other.point[1] - one.point[1]); // what is far away first
  for (const { point, colour } of things) drawStem(ctx, view, point, RADIUS, colour);
  for (const { point, draw } of things) draw(ctx, seen(view, point), state);
}

function drawTheGoal(ctx, { x, y, scale }, state) {
  drawGoal(ctx, x, y, 1.1 * RADIUS * scale, state);
}

function drawTheHand(ctx, { x, y, scale }) {
  drawHand(ctx, x, y, RADIUS * scale);
  disc(ctx, x, y, RADIUS * scale, null, INK, 1);
}

export const SCENES = { plane: drawClock, vertical: drawElevator, space: drawSpace };
