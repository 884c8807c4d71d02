// SPDX-License-Identifier: Apache-2.0
// Every sentence and label of both pages: the one place to translate. Labels and units of measures come
// from the bridge (`config.measures`), titles of protocols too.

import {
  ABORTED, FINISHED, MOVING, OVER_TIME, PAUSED, PREPARE, REACHED, RUNNING, SAFETY_OK,
  SAFETY_STOPPED, STARTING, WAIT, isUnderWay, isWeighed,
} from "./link.js";

// Why something did not work ----------------------------------------------------------------

const FAILURES = {
  lost: () => "the connection to the robot was lost",
  closed: () => "there is no connection to the robot",
  unanswered: (service) => `${service} did not answer`,
  silent: () => "The bridge does not answer.",
  refused: (why) => `Not let in: ${why}`,
};

// The sentence of an error; the bridge and the nodes send sentences themselves.
export function failure({ cause, message }) {
  return FAILURES[cause]?.(message) ?? message;
}

// The patient's screen ----------------------------------------------------------------------

export const SCREEN = {
  picture: "Where the hand is and where it is to go",
  progress: "Movements done",
  hands: { left: "Hand: left", right: "Hand: right" },
  dims: "This screen may dim or switch itself off: set it so that it stays on.",
  stop: "Please stop", unheard: "The robot does not hear it: tell your therapist",
  back: "Back", full: "Full screen", soundOn: "Sound: on", soundOff: "Sound: off",
  menu: "What shall we do?", hint: "Touch a picture to play. The therapist starts the exercises.",
  fruit: "Pick fruit", free: "Move freely", freely: "Move the blue hand wherever you like", start: "start",
};
// What the patient is asked, by the constants of TherapyState.msg: question, meaning of 0 and of 10.
export const QUESTIONS = {
  1: ["How much pain do you feel now?", "0: none", "10: the worst that you can think of"],
  2: ["How tired are you now?", "0: not at all", "10: as tired as can be"],
};
const WAITING = "One moment …";
const FOR_ROBOT = "Waiting for the robot";
const PATIENT_ASKED = "the patient asked"; // the session's reason after his own stop
const ASK_THERAPIST = "Your therapist knows what to do";

const WEIGHED = { // what is asked of him whose arm is weighed
  [WAIT]: ["Your arm is strapped in", "Lay it down, and let it rest"],
  [MOVING]: ["Let your arm hang", "Loose and heavy: the robot moves it to three places"],
};

const TASKS = {
  reach: "Move the blue hand to the orange diamond", circle: "Draw circles along the orange line",
  hold: "Hold your hand still", resisted: "Keep the blue hand on the orange diamond",
  strength: "Push in the direction of the arrow",
};

// What to do now in a session; isAtStart: the hand is where the movement begins.
export function task(state, isAtStart) {
  if (state.phase === PREPARE) return isAtStart ? "Get ready" : "Relax: the robot moves your hand";
  if (state.phase === REACHED) return "Well done";
  const lift = state.kind === "reach" && state.start.z !== state.target.z
    && state.start.x === state.target.x && state.start.y === state.target.y;
  const way = state.target?.z > state.start?.z ? "Lift" : "Lower";
  const words = lift ? `${way} the elevator to the person` : TASKS[state.kind] ?? "";
  if (state.phase === OVER_TIME && state.kind === "reach") return "Take your time";
  return [WAIT, MOVING, OVER_TIME].includes(state.phase) ? words : "";
}

// What covers the picture, [sign, title, more]; null when nothing does. sign: a picture of `scenes`.
export function veil({
  sentence, isOpen, isHeard, isTold, state, safety, reached, trials, hasSeenAll, hasOthers,
}) {
  if (!isOpen) return ["lost", WAITING, sentence || "Connecting to the robot"];
  if (!isHeard) return ["wait", FOR_ROBOT, "It does not tell anything yet"];
  const isOn = isUnderWay(state);
  if (isOn && !isTold) return ["wait", WAITING, "The exercise has stopped"];
  if (safety === SAFETY_STOPPED) return ["stop", "The robot has stopped", ASK_THERAPIST];
  if (safety !== SAFETY_OK) return ["wait", FOR_ROBOT, ASK_THERAPIST];
  if (isWeighed(state)) return ["wait", ...WEIGHED[state.phase] ?? ["Hands off the handle", "Only for a moment"]];
  if (state?.state === STARTING) return ["start", WAITING, "The exercise is about to begin"];
  if (state?.state === PAUSED) {
    if (state.rest != null) return ["pause", "A rest", `It goes on in ${seconds(state.rest)}`];
    const own = state.reason === PATIENT_ASKED;
    return ["pause", "Pause", own ? "As you asked. Tell your therapist why" : "The therapist goes on in a moment"];
  }
  if (state?.state === FINISHED) {
    const count = hasOthers ? `${reached} target${reached === 1 ? "" : "s"}` : `${reached} of ${trials} targets`;
    return ["flowers", "Finished. Thank you!", hasSeenAll ? `${count} reached` : ""];
  }
  if (state?.state === ABORTED) return ["done", "The exercise has ended", ""];
  return null;
}

function seconds(left) {
  return `${Math.max(0, Math.ceil(left))} s`;
}

export function noRobot(asked) {
  return `There is no robot ${asked} here: ask for the right address.`;
}

const SEASONS = ["Spring", "Summer", "Autumn", "Winter"];

// The line above the game; streak: fruit picked without a pause, 0 while it is too short to count.
export function gameLine({ score, picked, basket, streak }) {
  if (!picked) return "Move the blue hand to the fruit";
  const row = streak ? ` · ${streak} in a row` : "";
  return `${score} points · ${SEASONS[basket % SEASONS.length]}, basket ${basket + 1}${row}`;
}

// The therapist's page ----------------------------------------------------------------------

export const PAGE = {
  title: "Therapist's page", connecting: "Connecting …", connected: "Connected",
  unconnected: "No connection: a session that runs pauses by itself",
  lost: "The connection is lost. This page connects again by itself.",
  wrongRole: "This token is the patient's: open the therapist's address.",
  stop: "Software stop", notEmergency: "(not the emergency stop)",
  stopping: "Software stop asked for …",
  stopped: "The software stop was carried out. What to do now stands beside its button.",
  machine: "The robot", session: "Session", pseudonym: "Pseudonym", patient: "Pseudonym of the patient", fresh: "New",
  protocol: "Protocol", movements: "Protocol (movements)", record: "Record", start: "Start",
  armSide: "Arm", sides: { "": "which?", left: "left", right: "right" },
  rest: "Rest 1 min", rests: "goes on by itself",
  ask: "Ask for pain",
  dims: "This screen may dim: set it so that it stays on.", soundsOn: "Tones: on", soundsOff: "Tones: off",
  pause: "Pause", pauses: "walls go, the arm stays carried", resume: "Resume", end: "End session", save: "Stop recording",
  write: "Write down, elsewhere, whose pseudonym this is.",
  uncounted: "sessions not known",
  wanted: "A pseudonym like P-7K3QX is wanted: press New, or type it. No names.",
  sideWanted: "Which arm is it? Choose left or right.",
  notReady: "The robot is not ready: what it waits for stands above.", homing: "An axis is not homed: ask the operator.",
  modeOff: "Mode 0 gives no vertical force: ask the operator for another.", isWeighed: "An arm is being weighed.",
  before: "Before Start",
  support: "Support of the arm", carried: "Carried by the robot",
  lower: "Lower the arm", lowers: "slowly down, then let go",
  limits: "Limits", unknown: "Not known yet.",
  hand: "Hand [cm] (arrow: its force)", above: "From above: far is up",
  side: "From the side: far is right", traces: "Traces, time [s]",
  position: "Position [cm]", force: "Force of the patient on the robot [N]",
  axes: ["x right", "y away", "z up"],
  results: "Movements", reached: "Reached", yes: "✓ yes", no: "– no", noMovement: "No movement yet.",
  assistance: "Assistance", changes: "Changes of the assistance", noChange: "No change yet.",
};

// What is ticked before a session, by the bits of StartTherapy.srv.
export const CHECKS = {
  1: "Strap closed", 2: "Emergency stop tried today", 4: "Arm rest in place, or the lap is free",
  8: "Chair and handle as noted", 16: "Arm weighed, or hangs as last time",
};

export function toTick(words) {
  return `To be ticked: ${words}.`;
}

export const LIMITS = {
  "assistance.stiffness": "Stiffest wall, next session", "wish.half_width": "Workspace, left and right",
  "wish.half_depth": "Workspace, near and far", "wish.low": "Workspace, lowest height",
  "wish.high": "Workspace, greatest height", "wish.speed": "Greatest speed of games",
};

// The support of the arm ----------------------------------------------------------------------

const UNWEIGHED = 15, OVER = 2; // [N] without a weight, and beyond it: bounds of the session's node

function newtons(force) {
  return `${force.toFixed(1)} N`;
}

// The largest support [N] and why it is no more. weight: of the arm [N], null if it is not known.
export function supportLimit(weight, controller, drive) {
  const limits = [weight === null
    ? [UNWEIGHED, "the arm is not weighed"] : [weight + OVER, `the arm's weight and ${OVER} N`]];
  if (controller) {
    const reason = controller.support_limit === 0 ? "this mode feeds no force back: choose mode 3, 4 or 5"
      : drive && !drive.brakes ? "at a stop the drive coasts, so the arm falls" : "the robot carries no more";
    limits.push([controller.support_limit, reason]);
  }
  return limits.reduce((least, each) => (each[0] < least[0] ? each : least));
}

// How much is carried, also as a share of the weight.
export function supportShare(force, weight) {
  return weight ? `${newtons(force)}, ${Math.round((100 * force) / weight)} %` : newtons(force);
}

export function supportSentence(controller, most, reason) {
  if (!controller) return "The vertical axis is silent.";
  if (controller.hand_off) return "The hand has left the handle: the support is away until it is back.";
  return `In use ${newtons(controller.support)}, at most ${newtons(most)}: ${reason}.`;
}

// The button of the dialogue that weighs the arm.
export function weighWords(state) {
  if (!isWeighed(state)) return "Weigh the arm";
  return state.phase === WAIT ? "Strapped in: go on" : "End the weighing";
}

// What the arm weighs, and what the dialogue that weighs it waits for or has found.
export function armSentence(state) {
  if (!state) return "";
  const { arm, arm_weight: weight, arm_spread: spread } = state;
  if (arm) return `${arm[0].toUpperCase()}${arm.slice(1)}.`;
  return weight === null ? "The arm is not weighed." : `The arm weighs ${newtons(weight)}; its places differ by ${newtons(spread)}.`;
}

// What the software stop does to the arm.
export function stopSays(drive) {
  return drive?.brakes ? "torque off: the arm sinks, then falls" : "torque off: the arm falls";
}

export function robotTitle(robot) {
  return `Robot ${robot.slice(1)}`;
}

export function stopFailed(why) {
  return `The software stop failed: ${why}. Use the emergency stop.`;
}

// What stands beside Start; count: of the sessions recorded so far.
export function sessionOf(count) {
  return count ? `session ${count + 1}` : "first session";
}

export function again(patient) {
  return `${patient} again`;
}

export function patientSound(isOn) {
  return `Patient's sound: ${isOn ? "on" : "off"}`;
}

export function wasSet(name) {
  return `${LIMITS[name]}: set.`;
}

export function quantity(value, unit) {
  return unit === "m" ? `${(100 * value).toFixed(1)} cm` : `${value.toFixed(value < 10 ? 2 : 0)} ${unit}`;
}

// Title of a measure's column, as `Peak speed [mm/s]`.
export function measureTitle({ label, unit }) {
  const words = label[0].toUpperCase() + label.slice(1);
  return unit ? `${words} [${unit}]` : words;
}

// reaches, alone: results of the reaches, and of those without assistance.
export function resultSentence(patient, reaches, alone) {
  const apart = alone.length && alone.length < reaches.length
    ? `, without assistance ${counted(alone)}` : "";
  return `${patient}: ${counted(reaches)} targets reached${apart}`;
}

function counted(reaches) {
  return `${reaches.filter(({ reached }) => reached).length} of ${reaches.length}`;
}

// The assistance in use now.
export function assistanceSentence(state) {
  if (!isUnderWay(state)) return "";
  const { assisted, duration, side_stiffness: side } = state;
  return assisted ? `Now: ${duration.toFixed(2)} s a movement, side walls ${side.toFixed(0)} N/m` : "Now: without assistance";
}

export function changeSentence({ block, circuit, duration, side, reason }) {
  return `Block ${block}, circuit ${circuit}: ${duration.toFixed(2)} s, side walls ${side.toFixed(0)} N/m; ${reason}`;
}

const PHASES = {
  [PREPARE]: "the robot brings the hand to the start and holds it there", [WAIT]: "the target is shown",
  [MOVING]: "the patient moves", [OVER_TIME]: "over time, the wall stiffens slowly",
  [REACHED]: "reached",
};

// Where the session is, in one sentence.
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
    case STARTING:
      if (state.asks) return `${state.patient}: ${title}. Starting: the patient is asked on his screen; Resume goes on without.`;
      return `${state.patient}: ${title}. Starting: ${state.reason}.`;
    case PAUSED:
      if (state.rest != null) return `${state.patient}: ${title}. ${count}: a rest, ${seconds(state.rest)} left; Resume ends it. ${kept}`;
      return `${state.patient}: ${title}. Paused, ${count}: ${state.reason}. ${kept}`;
    case FINISHED:
      return `${state.patient}. Finished: ${title}, ${state.trials} movements.`;
    case ABORTED:
      return `${state.patient}: ${title}. Ended before its time: ${state.reason}.`;
    default:
      return "Press New for a pseudonym, choose arm and protocol, tick the list, press Start.";
  }
}

const ASKED = { 1: "The patient is asked for pain on his screen.", 2: "The patient is asked for tiredness on his screen." };
const GO_ON = 1; // of TherapyState.goes_on

// What the patient has told of pain and tiredness, [sentence, whether the therapist is asked to go on].
export function askedSentence(state) {
  if (!state) return ["", false];
  const told = [["pain", state.pain], ["tiredness", state.tired]].filter(([, value]) => value != null)
    .map(([name, value]) => `${name} ${value} of 10`).join(", ");
  const isAsked = state.goes_on === GO_ON && isUnderWay(state);
  const now = ASKED[state.asks] ?? "";
  const tells = told && `He tells ${told}.`;
  return [[now, tells, isAsked && !now ? "Go on? Resume is yes, End session is no." : ""].filter(Boolean).join(" "), isAsked];
}

const BADGES = {
  [RUNNING]: ["▶\ufe0e Running", "running"], [STARTING]: ["… Starting", "paused"],
  [PAUSED]: ["❚❚ Paused", "paused"], [FINISHED]: ["✓ Finished", ""], [ABORTED]: ["✕ Ended", ""],
};

// The state at a glance, [sign and word, its kind].
export function badge(state, safety) {
  if (safety?.level === SAFETY_STOPPED) return ["■ Stopped", "stopped"];
  if (safety?.level !== SAFETY_OK) return ["… Waiting", "paused"];
  return BADGES[state?.state] ?? ["○ No session", ""];
}

// What to hear of a change of the state, the name of a tone; "" for none. The therapist's own pause and a rest need none.
export function alarm(before, state, wasStopped, isStopped) {
  if (isStopped && !wasStopped) return "stopped";
  const isNew = state?.state === PAUSED && (before?.state !== PAUSED || before.reason !== state.reason);
  return isNew && state.rest == null && state.reason !== "the therapist paused it" ? "paused" : "";
}

// What to do after a stop. Only an operator resets it: no page has that right.
function wayOut(state) {
  const isOn = isUnderWay(state);
  const after = isOn ? "Resume, which repeats the movement, or End session" : "Start";
  return "See to the patient first. This page cannot start the robot again: ask its operator to remove "
    + `the cause, reset the stop and switch the torque on at the robot's computer. Then press ${after}.`;
}

// The supervisor's word for a stop by `estop`, which is all that this page's button does.
const ESTOP = "emergency stop";

const DRIVES = { plane: [0], vertical: [1], space: [0, 1] }, AXES = { plane: [0, 1], vertical: [2], space: [0, 1, 2] };

// Why the robot cannot begin a protocol in a space; "" if it can.
export function unready(safety, endpoint, controller, state, space) {
  if (isWeighed(state)) return PAGE.isWeighed;
  if (safety?.level !== SAFETY_OK || !DRIVES[space].every((i) => endpoint?.enabled[i])) return PAGE.notReady;
  if (!AXES[space].every((i) => endpoint.valid[i])) return PAGE.homing;
  return space !== "plane" && controller?.mode === 0 ? PAGE.modeOff : "";
}

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
