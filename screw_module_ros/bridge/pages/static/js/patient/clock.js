// SPDX-License-Identifier: Apache-2.0
// The clock game: targets round a centre, seen from above; away from the patient is up.

import { INK, LINE, ORANGE, SKY, SOFT } from "../colours.js";
import { arrow, disc, line } from "../shapes.js";
import { PREPARE, targetsOf } from "../states.js";
import { drawGoal, drawHand } from "./marks.js";

const HALF = 0.185; // of the workspace that is shown [m]
const LEAST = 20; // radius of a target on the screen, however small its own [pixel]

export function drawClock({ ctx, width, height }, world) {
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
