// SPDX-License-Identifier: Apache-2.0
// The hand and the goals as every scene shows them: the hand a blue disc, the start a ring, the
// target an orange diamond, what was reached a green disc with a tick.

import { BLUE, GREEN, INK, ORANGE, PAPER, VERMILLION } from "../colours.js";
import { arc, diamond, disc, tick } from "../shapes.js";
import { MOVING, OVER_TIME, PREPARE, REACHED } from "../states.js";

export function drawHand(ctx, x, y, radius) {
  disc(ctx, x, y, radius, BLUE, "#ffffff", 0.18 * radius);
  disc(ctx, x, y, 0.3 * radius, "#ffffff");
}

// Draws where the hand is to go in this phase of a trial.
export function drawGoal(ctx, x, y, radius, state) {
  if (state.phase === PREPARE) {
    disc(ctx, x, y, radius, PAPER, INK, 0.16 * radius);
    return;
  }
  if (state.phase === REACHED) {
    disc(ctx, x, y, 1.15 * radius, GREEN);
    tick(ctx, x, y, radius, "#ffffff");
    return;
  }
  diamond(ctx, x, y, 1.25 * radius, ORANGE, INK, 0.1 * radius);
  const since = state.since ?? 0;
  if (state.phase === MOVING || state.phase === OVER_TIME) {
    const colour = state.phase === MOVING ? INK : VERMILLION;
    arc(ctx, x, y, 1.75 * radius, since / Math.max(state.duration, 0.1), colour, 0.16 * radius);
  }
}
