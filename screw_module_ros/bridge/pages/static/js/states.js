// SPDX-License-Identifier: Apache-2.0
// Constants of TherapyState.msg and SafetyState.msg.

export const IDLE = 0, RUNNING = 1, PAUSED = 2, FINISHED = 3, ABORTED = 4;
export const NONE = 0, PREPARE = 1, WAIT = 2, MOVING = 3, OVER_TIME = 4, REACHED = 5;
export const SAFETY_OK = 0, SAFETY_WAITING = 1, SAFETY_STOPPED = 2;

// A session that begins is paused with this reason until its recording has begun.
const AWAITS_RECORDING = "waiting for the recording";

export function isBeginning({ state, reason }) {
  return state === PAUSED && reason === AWAITS_RECORDING;
}

// The targets of the block that runs: those of all blocks together would overlap.
export function targetsOf(protocol, { block }) {
  const { blocks = {}, targets = [] } = protocol ?? {};
  return Object.hasOwn(blocks, block) ? blocks[block] : targets;
}
