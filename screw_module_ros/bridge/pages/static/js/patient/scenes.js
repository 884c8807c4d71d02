// SPDX-License-Identifier: Apache-2.0
// The pictures of a session. The clock: a flower bed seen from above; away from the patient is up. The
// elevator: the hand is the car of a house. Space: flowers on posts, on a floor that shows how far away
// they are. Each target that was reached makes the picture richer: a flower opens, a window lights up.
// The robot with a sign tells why there is no picture now.

import {
  BLUE, GREEN, INK, LINE, ORANGE, SKY, SOFT, VERMILLION, YELLOW, arrow, disc, drawFlower, drawGoal, drawHand,
  drawPalm, line, text, tick,
} from "../draw.js";
import { OVER_TIME, PREPARE, REACHED, sided, targetsOf } from "../link.js";
import { RADIUS, camera, drawFloor, drawPost, drawWay, seen } from "../space.js";
import { SCREEN } from "../words.js";

function asPoint([x, y, z] = [0, 0, 0]) {
  return { x, y, z };
}

// A place for a target: a bud, or a flower that has opened as often as the target was reached.
function drawPlace(ctx, x, y, radius, times) {
  if (times) drawFlower(ctx, x, y, radius, times);
  else disc(ctx, x, y, 0.8 * radius, "#ffffff", SOFT, 3);
}

// Clock -------------------------------------------------------------------------------------

const HALF = 0.195; // of the workspace that is shown [m]
const BIG = 0.03; // radius of a target, to be seen from two metres [m]
const LEAST = 20; // the same on the screen, however small [pixel]

function drawClock({ ctx, width, height }, world) {
  const scale = (Math.min(width, 0.83 * height) / 2 - 10) / HALF;
  const place = (p) => [width / 2 + scale * p.x, 0.56 * height - scale * p.y];
  const { state, hand, protocol, seen: count, bloom } = world;
  const radius = Math.max(LEAST, scale * (state.hit_radius || 0.01), BIG * scale);
  const [middle, ...places] = [protocol?.centre && sided(protocol, state.side, protocol.centre), ...targetsOf(protocol, state)].map(asPoint);
  const [cx, cy] = place(middle);
  disc(ctx, cx, cy, 0.185 * scale, "#ffffff", LINE, 4);
  for (const each of places) line(ctx, cx, cy, ...place(each), count.times(each) ? GREEN : LINE, 0.004 * scale);
  for (const each of [...places, middle]) drawPlace(ctx, ...place(each), radius, count.times(each));
  const isReached = state.phase === REACHED;
  const goal = state.phase === PREPARE ? state.start : state.target;
  if (state.kind === "circle") drawCircle(ctx, place, state, scale);
  else if (state.kind === "strength") drawPush(ctx, place, state, world.force, scale);
  else if (!isReached) drawGoal(ctx, ...place(goal), radius, state);
  if (hand.isKnown) drawHand(ctx, ...place(hand), 0.95 * radius, world.side);
  if (isReached) drawGoal(ctx, ...place(goal), radius, state, bloom);
}

function drawCircle(ctx, place, state, scale) {
  const [x, y] = place(state.start);
  const radius = Math.hypot(state.target.x - state.start.x, state.target.y - state.start.y);
  disc(ctx, x, y, radius * scale, null, INK, 0.014 * scale);
  disc(ctx, x, y, radius * scale, null, ORANGE, 0.01 * scale);
}

// The push that is asked for, and in it the one that is felt.
function drawPush(ctx, place, state, force, scale) {
  const [x, y] = place(state.start);
  const dx = state.target.x - state.start.x;
  const dy = state.target.y - state.start.y;
  const length = Math.hypot(dx, dy) || 1;
  const felt = Math.max(0, (force.x * dx + force.y * dy) / length);
  arrow(ctx, x, y, 0.17 * scale * (dx / length), -0.17 * scale * (dy / length), INK, 0.016 * scale);
  arrow(ctx, x, y, 0.165 * scale * (dx / length), -0.165 * scale * (dy / length), ORANGE, 0.013 * scale);
  const share = Math.min(felt / 40, 1) * 0.12 * scale;
  line(ctx, x, y, x + share * (dx / length), y - share * (dy / length), BLUE, 0.012 * scale);
}

// Elevator ----------------------------------------------------------------------------------

const LOW = 0.0, HIGH = 0.36, STOREY = 0.06; // [m] of travel
const WALL = "#f3e4c8", DARK = "#5d6b78";

export function drawElevator({ ctx, width, height }, world) {
  const top = 0.24 * height, bottom = height - Math.max(0.07 * height, 120);
  const at = (z) => bottom - ((z - LOW) / (HIGH - LOW)) * (bottom - top);
  const shaft = Math.min(0.26 * width, 0.3 * height);
  const left = width / 2 - shaft / 2;
  const { state, hand, seen: count } = world;
  drawHouse(ctx, left, shaft, at, count?.reached ?? 0);
  const goal = state.phase === PREPARE ? state.start : state.target;
  const half = Math.max(0.17 * shaft, at(0) - at(state.hit_radius || 0.01));
  drawStorey(ctx, left, shaft, at(goal.z), half, world);
  if (hand.z !== null) drawCar(ctx, left + 0.1 * shaft, at(hand.z), 0.8 * shaft, half, at(HIGH), world);
}

// A house with windows beside the shaft: somebody gets home with each target that was reached.
function drawHouse(ctx, left, shaft, at, reached) {
  const [x, wide, top, bottom] = [left - 0.75 * shaft, 2.5 * shaft, at(HIGH + 0.01), at(LOW - 0.01)];
  const storey = at(0) - at(STOREY);
  ctx.beginPath();
  ctx.moveTo(x - 0.15 * shaft, top);
  ctx.lineTo(x + wide / 2, top - 0.9 * storey);
  ctx.lineTo(x + wide + 0.15 * shaft, top);
  ctx.closePath();
  ctx.fillStyle = DARK;
  ctx.fill();
  ctx.fillStyle = WALL;
  ctx.fillRect(x, top, wide, bottom - top);
  ctx.lineWidth = 3;
  ctx.strokeStyle = DARK;
  ctx.strokeRect(x, top, wide, bottom - top);
  ctx.fillStyle = "#ffffff";
  ctx.fillRect(left, top, shaft, bottom - top);
  ctx.strokeRect(left, top, shaft, bottom - top);
  const windows = 2 * Math.round((HIGH - LOW) / STOREY);
  const isAllLit = reached && reached % windows === 0;
  for (let i = 0; i < windows; i++) {
    const isLit = isAllLit || i < reached % windows;
    const [wx, wy] = [x + 0.1 * shaft + (i % 2) * 0.3 * shaft, at(STOREY * (Math.floor(i / 2) + 0.8))];
    ctx.fillStyle = isLit ? YELLOW : "#9fb0bd";
    ctx.fillRect(wx, wy, 0.22 * shaft, 0.6 * storey);
    if (isLit) {
      disc(ctx, wx + 0.11 * shaft, wy + 0.25 * storey, 0.1 * storey, INK);
      ctx.fillStyle = INK;
      ctx.fillRect(wx + 0.05 * shaft, wy + 0.4 * storey, 0.12 * shaft, 0.2 * storey);
    }
    ctx.strokeRect(wx, wy, 0.22 * shaft, 0.6 * storey);
  }
}

// The storey to go to, where somebody waits.
function drawStorey(ctx, left, shaft, y, half, { state, bloom = 1 }) {
  const isStart = state.phase === PREPARE, isReached = state.phase === REACHED;
  const colour = isReached ? GREEN : isStart ? SKY : ORANGE;
  ctx.globalAlpha = 0.55;
  ctx.fillStyle = colour;
  ctx.fillRect(left, y - 1.25 * half, shaft, 2.5 * half);
  ctx.globalAlpha = 1;
  for (const side of [-1, 1]) line(ctx, left, y + side * 1.25 * half, left + shaft, y + side * 1.25 * half, INK, 4);
  const x = left + 1.32 * shaft;
  if (isReached) { // who waited has got in
    disc(ctx, x, y, (0.7 + 0.4 * bloom) * half, GREEN, "#ffffff", 3);
    tick(ctx, x, y, (0.7 + 0.4 * bloom) * half, "#ffffff");
    return;
  }
  if (isStart) {
    text(ctx, SCREEN.start, x, y, 0.9 * half, INK);
    return;
  }
  arrow(ctx, left + 1.12 * shaft, y, -0.1 * shaft, 0, INK, 0.022 * shaft);
  drawPerson(ctx, x, y, 1.3 * half, state.phase === OVER_TIME ? VERMILLION : INK);
}

function drawPerson(ctx, x, y, size, colour) {
  disc(ctx, x, y - 0.6 * size, 0.28 * size, colour);
  line(ctx, x, y - 0.1 * size, x, y + 0.3 * size, colour, 0.42 * size);
  for (const side of [-1, 1]) line(ctx, x + 0.12 * side * size, y + 0.3 * size, x + 0.12 * side * size, y + 0.85 * size, colour, 0.18 * size);
  line(ctx, x - 0.15 * size, y - 0.1 * size, x - 0.55 * size, y - 0.5 * size, colour, 0.15 * size); // waves
  line(ctx, x + 0.2 * size, y - 0.1 * size, x + 0.32 * size, y + 0.3 * size, colour, 0.15 * size);
}

function drawCar(ctx, x, y, width, half, top, { state, side }) {
  line(ctx, x + width / 2, top, x + width / 2, y - half, INK, 4);
  ctx.fillStyle = BLUE;
  ctx.strokeStyle = "#ffffff";
  ctx.lineWidth = 4;
  ctx.beginPath();
  ctx.roundRect(x, y - half, width, 2 * half, 0.3 * half);
  ctx.fill();
  ctx.stroke();
  const isTaken = state.phase === REACHED; // the passenger
  drawPalm(ctx, x + (isTaken ? 0.32 : 0.5) * width, y + 0.06 * half, 1.25 * half, side);
  if (isTaken) drawPerson(ctx, x + 0.68 * width, y, 0.95 * half, "#ffffff");
}

// Space -------------------------------------------------------------------------------------

export function drawSpace({ ctx, width, height }, world) {
  const view = camera(width, height);
  const { state, hand, protocol, seen: count, bloom, side } = world;
  drawFloor(ctx, view, "#ffffff", "#e3e0d6");
  const places = targetsOf(protocol, state).map(asPoint);
  places.sort((one, other) => other.y - one.y); // what is far away first
  for (const each of places) {
    const { x, y, scale } = seen(view, [each.x, each.y, each.z]);
    drawPlace(ctx, x, y, 0.7 * RADIUS * scale, count.times(each));
  }
  const goal = state.phase === PREPARE ? state.start : state.target;
  const isReached = state.phase === REACHED;
  const things = [];
  if (hand.isKnown) {
    things.push({
      point: [hand.x, hand.y, hand.z], colour: BLUE,
      draw: ({ x, y, scale }) => drawHand(ctx, x, y, RADIUS * scale, side),
    });
  }
  if (state.kind) {
    things.push({
      point: [goal.x, goal.y, goal.z], colour: isReached ? GREEN : state.phase === PREPARE ? SOFT : ORANGE,
      draw: ({ x, y, scale }) => drawGoal(ctx, x, y, RADIUS * scale, state, bloom),
    });
  }
  if (!isReached) things.sort((one, other) => other.point[1] - one.point[1]);
  for (const { point, colour } of things) drawPost(ctx, view, point, RADIUS, colour);
  if (things.length === 2 && !isReached) drawWay(ctx, view, [hand.x, hand.y], [goal.x, goal.y], INK);
  for (const { point, draw } of things) draw(seen(view, point));
}

export const SCENES = { plane: drawClock, vertical: drawElevator, space: drawSpace };

// Signs -------------------------------------------------------------------------------------

const SIGNS = { // colour and shape on it, by the name of the sign
  wait: [INK, (ctx, x, y, size) => [-1, 0, 1].forEach((i) => disc(ctx, x + 0.5 * i * size, y, 0.16 * size, "#ffffff"))],
  stop: [VERMILLION, (ctx, x, y, size) => square(ctx, x, y, 0.45 * size)],
  pause: [BLUE, (ctx, x, y, size) => [-1, 1].forEach(
    (i) => line(ctx, x + 0.27 * i * size, y - 0.4 * size, x + 0.27 * i * size, y + 0.4 * size, "#ffffff", 0.26 * size))],
  start: [GREEN, (ctx, x, y, size) => triangle(ctx, x, y, 0.55 * size)],
  lost: [INK, (ctx, x, y, size) => [-1, 1].forEach(
    (i) => line(ctx, x - 0.4 * size, y - 0.4 * i * size, x + 0.4 * size, y + 0.4 * i * size, "#ffffff", 0.2 * size))],
  done: [GREEN, (ctx, x, y, size) => tick(ctx, x, y, size, "#ffffff")],
};

// The robot with a sign, its eyes shut while it does not move; flowers for who has done it all.
export function drawSign({ ctx, width, height }, name) {
  const size = Math.min(width, height) / 2.5;
  const [x, y] = [width / 2, height / 2];
  if (name === "flowers") {
    [[-0.6, 0.3], [0.6, 0.3], [0, -0.1]].forEach(([dx, dy], i) =>
      drawFlower(ctx, x + dx * size, y + dy * size, (i === 2 ? 0.9 : 0.55) * size, i + 1));
    return;
  }
  const [colour, shape] = SIGNS[name];
  line(ctx, x, y - 0.5 * size, x, y - 0.85 * size, INK, 0.07 * size);
  disc(ctx, x, y - 0.85 * size, 0.1 * size, ORANGE, INK, 0.04 * size);
  ctx.fillStyle = SKY;
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.07 * size;
  ctx.beginPath();
  ctx.roundRect(x - 0.75 * size, y - 0.55 * size, 1.5 * size, 1.25 * size, 0.3 * size);
  ctx.fill();
  ctx.stroke();
  for (const side of [-1, 1]) {
    const eye = x + 0.33 * side * size;
    if (name === "start") disc(ctx, eye, y - 0.12 * size, 0.11 * size, INK);
    else line(ctx, eye - 0.12 * size, y - 0.1 * size, eye + 0.12 * size, y - 0.1 * size, INK, 0.07 * size);
  }
  ctx.beginPath();
  ctx.arc(x, y + 0.12 * size, 0.28 * size, 0.15 * Math.PI, 0.85 * Math.PI);
  ctx.stroke();
  disc(ctx, x + 0.72 * size, y + 0.5 * size, 0.46 * size, colour, "#ffffff", 0.06 * size);
  shape(ctx, x + 0.72 * size, y + 0.5 * size, 0.46 * size);
}

function square(ctx, x, y, half) {
  ctx.fillStyle = "#ffffff";
  ctx.fillRect(x - half, y - half, 2 * half, 2 * half);
}

function triangle(ctx, x, y, size) {
  ctx.fillStyle = "#ffffff";
  ctx.beginPath();
  ctx.moveTo(x - 0.7 * size, y - size);
  ctx.lineTo(x + size, y);
  ctx.lineTo(x - 0.7 * size, y + size);
  ctx.fill();
}
