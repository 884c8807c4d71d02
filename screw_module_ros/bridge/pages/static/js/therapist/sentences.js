// SPDX-License-Identifier: Apache-2.0
// States and reasons as sentences for the therapist.

import {
  ABORTED, FINISHED, MOVING, OVER_TIME, PAUSED, PREPARE, REACHED, RUNNING, SAFETY_OK,
  SAFETY_STOPPED, WAIT, isBeginning,
} from "../states.js";

const PHASES = {
  [PREPARE]: "the robot brings the hand to the start", [WAIT]: "the target is shown",
  [MOVING]: "the patient moves", [OVER_TIME]: "over time, the wall stiffens slowly",
  [REACHED]: "reached",
};

export function sessionSentence(state, protocols) {
  if (!state) return "The session node is silent.";
  const title = protocols.find(({ protocol }) => protocol === state.protocol)?.title ?? state.protocol;
  const kept = state.recorded ? "It is recorded." : "It is not recorded.";
  const count = `movement ${state.trial} of ${state.trials}`;
  switch (state.state) {
    case RUNNING: {
      const isAlone = state.phase === OVER_TIME && !state.assisted; // there is no wall
      const words = isAlone ? "over time" : PHASES[state.phase];
      const phase = words ? `: ${words}` : "";
      return `${state.patient}: ${title}. Running, ${count}${phase}. ${kept}`;
    }
    case PAUSED:
      if (isBeginning(state)) return `${state.patient}: ${title}. Starting: ${state.reason}.`;
      return `${state.patient}: ${title}. Paused, ${count}: ${state.reason}. ${kept}`;
    case FINISHED:
      return `${state.patient}. Finished: ${title}, ${state.trials} movements.`;
    case ABORTED:
      return `${state.patient}: ${title}. Ended before its time: ${state.reason}.`;
    default:
      return "No session.";
  }
}

// What to do after a stop. Only an operator resets it: no page has that right.
function wayOut(state) {
  const isOn = state?.state === RUNNING || state?.state === PAUSED;
  const after = isOn ? "Resume, which repeats the movement, or End session" : "Start";
  return "See to the patient first. This page cannot start the robot again: ask its operator to remove "
    + `the cause, reset the stop and switch the torque on at the robot's computer. Then press ${after}.`;
}

// The supervisor's word for a stop by `estop`, which is all that this page's button does.
const ESTOP = "emergency stop";

// What stands in the way of motion, [sentence, whether it is bad].
export function safetySentence(safety, endpoint, state) {
  if (!safety) return ["The supervisor says nothing: no motion is permitted.", true];
  const told = safety.reasons.map((each) => (each === ESTOP ? "the software stop was asked for" : each));
  const reasons = told.join("; ");
  if (safety.level === SAFETY_STOPPED) {
    return [`The robot has stopped: ${reasons || "no reason told"}. ${wayOut(state)}`, true];
  }
  if (safety.level !== SAFETY_OK) return [`Waiting: ${reasons || "no reason told"}.`, true];
  if (!endpoint) return ["The robot's position is silent.", true];
  const off = [["plane", 0], ["vertical", 1]].filter(([, i]) => !endpoint.enabled[i]);
  if (off.length) return [`The torque is off: ${off.map(([name]) => name).join(" and ")}.`, true];
  return ["The robot is ready, the torque is on.", false];
}
