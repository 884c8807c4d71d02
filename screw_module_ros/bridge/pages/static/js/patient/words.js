// SPDX-License-Identifier: Apache-2.0
// What the patient is told, by what the robot tells.

import {
  ABORTED, FINISHED, MOVING, OVER_TIME, PAUSED, PREPARE, REACHED, RUNNING, SAFETY_OK,
  SAFETY_STOPPED, WAIT, isBeginning,
} from "../states.js";

const DO = {
  reach: "Move to the orange diamond", circle: "Draw circles along the orange line",
  hold: "Hold your hand still", resisted: "Stay at the orange diamond",
  strength: "Push in the direction of the arrow",
};

// What to do now in a session.
export function task(state) {
  if (state.phase === PREPARE) return "The robot brings your hand to the start";
  if (state.phase === REACHED) return "Well done";
  const lift = state.kind === "reach" && state.start.z !== state.target.z
    && state.start.x === state.target.x && state.start.y === state.target.y;
  const words = lift ? "Take the elevator to the marked floor" : DO[state.kind] ?? "";
  if (state.phase === OVER_TIME) return `${words}: take your time`;
  return state.phase === WAIT || state.phase === MOVING ? words : "";
}

// What covers the picture, [title, more]; null when nothing does.
export function veil({
  sentence, isOpen, isHeard, isTold, state, safety, reached, trials, hasSeenAll, hasOthers,
}) {
  if (!isOpen) return ["One moment …", sentence || "Connecting to the robot"];
  if (!isHeard) return ["One moment …", "The robot does not tell anything yet"];
  const isOn = state?.state === PAUSED || state?.state === RUNNING;
  if (isOn && !isTold) return ["One moment …", "The exercise has stopped"];
  if (safety === SAFETY_STOPPED) return ["The robot has stopped", "Your therapist knows what to do"];
  if (safety !== SAFETY_OK) return ["The robot rests", "Your therapist knows what to do"];
  if (state && isBeginning(state)) return ["One moment …", "The exercise is about to begin"];
  if (state?.state === PAUSED) return ["Pause", "The therapist goes on in a moment"];
  if (state?.state === FINISHED) {
    const count = hasOthers ? `${reached} target${reached === 1 ? "" : "s"}` : `${reached} of ${trials} targets`;
    return ["Finished. Thank you!", hasSeenAll ? `${count} reached` : ""];
  }
  if (state?.state === ABORTED) return ["The exercise has ended", ""];
  return null;
}
