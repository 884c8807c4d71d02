// SPDX-License-Identifier: Apache-2.0
// Reaching in space: targets as lanterns on a shelf, each with a stem and a shadow on the floor.

import { BLUE, INK, LINE, ORANGE, SOFT } from "../colours.js";
import { disc } from "../shapes.js";
import { PREPARE, targetsOf } from "../states.js";
import { camera, drawFloor, drawStem, seen } from "./depth.js";
import { drawGoal, drawHand } from "./marks.js";

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
