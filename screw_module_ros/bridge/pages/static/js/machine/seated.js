// SPDX-License-Identifier: Apache-2.0
// Who sits at the machine, for a picture of the whole: a patient of average size on a chair, his right
// hand and forearm in the cradle, and the table. Sizes are ours [m]; nothing here is measured.

import { plus } from "./kinematics.js";

const SKIN = [0.91, 0.74, 0.62], SHIRT = [0.36, 0.55, 0.50], TROUSERS = [0.30, 0.34, 0.45];
const HAIR = [0.35, 0.27, 0.22], SHOE = [0.2, 0.2, 0.22], WOOD = [0.86, 0.80, 0.70], CHAIR = [0.45, 0.47, 0.50];
const FLOOR = -0.86, TABLE = -0.14, SEAT = -0.37;
const ASIDE = -0.11; // he sits so that his forearm lies along the cradle
const SHOULDER = [ASIDE + 0.19, -0.57, 0.20], UPPER = 0.30, LOWER = 0.34; // lower: elbow to the hand
const STILL = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

const CUT = 0.2; // coarse: nothing is close to them

const box = (x, y, z, at, rgb) => ({ kind: "box", size: [x, y, z], rgb, pose: { turn: STILL, at }, cut: CUT });
const ball = (radius, at, rgb) => ({ kind: "ball", size: [radius], rgb, pose: { turn: STILL, at } });

// A limb from one point to another, round at its ends.
function limb(from, to, radius, rgb) {
  const way = to.map((value, i) => value - from[i]);
  const length = Math.hypot(...way);
  const z = way.map((value) => value / length);
  const flat = Math.hypot(z[0], z[1]);
  const x = flat > 1e-9 ? [-z[1] / flat, z[0] / flat, 0] : [1, 0, 0];
  const y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
  const turn = [0, 1, 2].map((i) => [x[i], y[i], z[i]]);
  const middle = plus(from, way.map((value) => value / 2));
  return [
    { kind: "cylinder", size: [radius, length], rgb, pose: { turn, at: middle }, cut: 2 * radius },
    ball(radius, from, rgb), ball(radius, to, rgb),
  ];
}

// The elbow of an arm from the shoulder to a hand: half down, half outward.
function elbowTo(hand) {
  const way = hand.map((value, i) => value - SHOULDER[i]);
  const far = Math.min(Math.hypot(...way), UPPER + LOWER - 1e-3);
  const along = way.map((value) => value / Math.hypot(...way));
  const share = (UPPER * UPPER - LOWER * LOWER + far * far) / (2 * far);
  const down = [0.6, 0, -0.8];
  const part = down.reduce((sum, value, i) => sum + value * along[i], 0);
  const aside = down.map((value, i) => value - part * along[i]);
  const high = Math.sqrt(Math.max(0, UPPER * UPPER - share * share)) / Math.hypot(...aside);
  return SHOULDER.map((value, i) => value + share * along[i] + high * aside[i]);
}

export function table() {
  const legs = [[-0.62, -0.28], [0.62, -0.28], [-0.62, 0.34], [0.62, 0.34]];
  return [
    box(1.36, 0.76, 0.03, [0, 0.03, TABLE - 0.015], WOOD),
    ...legs.map(([x, y]) => (
      { ...box(0.05, 0.05, TABLE - 0.03 - FLOOR, [x, y, (TABLE - 0.03 + FLOOR) / 2], WOOD), open: true })),
  ];
}

// The patient with the handle at a place; his hand is about the grip, above it.
export function patient(x, y, z) {
  const hand = [x, y - 0.02, z + 0.075];
  const elbow = elbowTo(hand);
  const from = (x, y, z) => [ASIDE + x, y, z];
  const left = from(-0.19, -0.57, 0.20), rest = from(-0.27, -0.50, -0.09), lap = from(-0.14, -0.26, -0.09);
  const parts = [
    box(0.44, 0.42, 0.05, from(0, -0.66, SEAT - 0.025), CHAIR),
    box(0.42, 0.04, 0.50, from(0, -0.85, SEAT + 0.36), CHAIR),
    box(0.06, 0.06, SEAT - 0.05 - FLOOR, from(0, -0.66, (SEAT - 0.05 + FLOOR) / 2), CHAIR),
    box(0.46, 0.46, 0.03, from(0, -0.66, FLOOR + 0.015), CHAIR),
    ...limb(from(0, -0.68, SEAT + 0.12), from(0, -0.63, 0.07), 0.125, SHIRT),
    ...limb(from(-0.13, -0.6, 0.17), from(0.13, -0.6, 0.17), 0.072, SHIRT),
    ...limb(from(0, -0.6, 0.20), from(0, -0.595, 0.31), 0.05, SKIN),
    ball(0.098, from(0, -0.575, 0.385), SKIN), ball(0.098, from(0, -0.602, 0.412), HAIR),
    ...limb(SHOULDER, elbow, 0.048, SHIRT), ...limb(elbow, hand, 0.036, SKIN), ball(0.045, hand, SKIN),
    ...limb(left, rest, 0.048, SHIRT), ...limb(rest, lap, 0.036, SKIN), ball(0.045, lap, SKIN),
  ];
  for (const side of [-0.1, 0.1]) {
    const knee = from(1.2 * side, -0.22, SEAT + 0.06), foot = from(1.2 * side, -0.20, FLOOR + 0.09);
    parts.push(...limb(from(side, -0.64, SEAT + 0.08), knee, 0.07, TROUSERS), ...limb(knee, foot, 0.052, TROUSERS));
    parts.push(box(0.09, 0.25, 0.07, from(1.2 * side, -0.14, FLOOR + 0.035), SHOE));
  }
  return parts;
}
