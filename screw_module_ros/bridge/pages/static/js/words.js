// SPDX-License-Identifier: Apache-2.0
// Sentences of the therapist's pages, and what is said when on the patient's screen, whose own sentences are
// in `patient/languages.js`. What tables and choices are made of is in `cells.js`.

import { dueWords, minutesWords, moment, newtons, proposal, sideWords } from "./cells.js";
import {
  ABORTED, FINISHED, MOVING, OVER_TIME, PAUSED, PREPARE, REACHED, RUNNING, SAFETY_OK,
  SAFETY_STOPPED, STARTING, WAIT, isResting, isUnderWay, isWeighed,
} from "./link.js";
import { said, t, table } from "./language.js";
import { LANGUAGES, chosenLanguage } from "./patient/languages.js";

// Why something did not work ----------------------------------------------------------------

const FAILURES = {
  lost: () => t("the connection to the robot was lost"),
  closed: () => t("there is no connection to the robot"),
  unanswered: (service) => t("{0} did not answer", service),
  silent: () => t("The bridge does not answer."),
  refused: (why) => t("Not let in: {0}", said(why)),
};

// The sentence of an error; the bridge and the nodes say some themselves.
export function failure({ cause, message }) {
  return FAILURES[cause]?.(message) ?? said(message);
}

// The patient's screen ----------------------------------------------------------------------

// In the language that was chosen there.
export const SCREEN = LANGUAGES[chosenLanguage()];
const PATIENT_ASKED = "the patient asked"; // the session's reason after his own stop

// What to do now in a session; isAtStart: the hand is where the movement begins.
export function task(state, isAtStart) {
  if (state.phase === PREPARE) return isAtStart ? SCREEN.ready : SCREEN.relax;
  if (state.phase === REACHED) return SCREEN.wellDone;
  const lift = state.kind === "reach" && state.start.z !== state.target.z
    && state.start.x === state.target.x && state.start.y === state.target.y;
  const way = state.target?.z > state.start?.z ? SCREEN.lift : SCREEN.lower;
  const words = lift ? way : SCREEN.tasks[state.kind] ?? "";
  if (state.phase === OVER_TIME && state.kind === "reach") return SCREEN.takeTime;
  return [WAIT, MOVING, OVER_TIME].includes(state.phase) ? words : "";
}

// What is asked of him whose arm is weighed.
const WEIGHED = { [WAIT]: SCREEN.strapped, [MOVING]: SCREEN.hang };

// What covers the picture, [sign, title, more]; null when nothing does. sign: a picture of `scenes`.
export function veil({
  sentence, isOpen, isHeard, isTold, state, safety, reached, trials, hasSeenAll, hasOthers,
}) {
  if (!isOpen) return ["lost", SCREEN.waiting, sentence || SCREEN.connecting];
  if (!isHeard) return ["wait", SCREEN.forRobot, SCREEN.silent];
  const isOn = isUnderWay(state);
  if (isOn && !isTold) return ["wait", SCREEN.waiting, SCREEN.ceased];
  if (safety === SAFETY_STOPPED) return ["stop", SCREEN.stopped, SCREEN.askTherapist];
  if (safety !== SAFETY_OK) return ["wait", SCREEN.forRobot, SCREEN.askTherapist];
  if (isWeighed(state)) return ["wait", ...WEIGHED[state.phase] ?? SCREEN.handsOff];
  if (state?.state === STARTING) return ["start", SCREEN.waiting, SCREEN.begins];
  if (state?.state === PAUSED) {
    if (isResting(state)) return ["pause", SCREEN.rest, SCREEN.goesOn(whole(state.rest))];
    return ["pause", SCREEN.pause, state.reason === PATIENT_ASKED ? SCREEN.own : SCREEN.paused];
  }
  if (state?.state === FINISHED) {
    const count = hasOthers ? SCREEN.reached(reached) : SCREEN.reachedOf(reached, trials);
    return ["flowers", SCREEN.finished, hasSeenAll && state.kind !== "game" ? count : ""];
  }
  if (state?.state === ABORTED) return ["done", SCREEN.ended, ""];
  return null;
}

function whole(seconds) {
  return Math.max(0, Math.ceil(seconds));
}

export function noRobot(asked) {
  return SCREEN.noRobot(asked);
}

// The line above the game; streak: fruit picked without a pause, 0 while it is too short to count.
export function gameLine({ score, picked, basket, streak }) {
  if (!picked) return SCREEN.toFruit;
  const line = SCREEN.points(score, SCREEN.seasons[basket % SCREEN.seasons.length], basket + 1);
  return streak ? line + SCREEN.row(streak) : line;
}

// The therapist's page ----------------------------------------------------------------------

export const PAGE = table({
  title: "Therapist's page", patients: "Patients", connecting: "Connecting …", connected: "Connected",
  unconnected: "No connection: a session that runs pauses by itself",
  lost: "The connection is lost. This page connects again by itself.",
  wrongRole: "This token is the patient's: open the therapist's address.",
  stop: "Software stop", notEmergency: "(not the emergency stop)",
  stopping: "Software stop asked for …",
  stopped: "The software stop was carried out. What to do now stands beside its button.",
  machine: "The robot", session: "Session", pseudonym: "Pseudonym", patient: "Pseudonym of the patient", fresh: "New",
  protocol: "Protocol", movements: "Protocol (movements), game", games: "Games", level: "Level", minutes: "Minutes",
  plan: "Add to the plan", lastTime: "As last time", record: "Record", start: "Start",
  armSide: "Arm",
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
});

// What is ticked before a session, by the bits of StartTherapy.srv.
export const CHECKS = table({
  1: "Strap closed", 2: "Emergency stop tried today", 4: "Arm rest in place, or the lap is free",
  8: "Chair and handle as noted", 16: "Arm weighed, or hangs as last time",
});

export function toTick(words) {
  return t("To be ticked: {0}.", words);
}

export const LIMITS = table({
  "assistance.stiffness": "Stiffest wall, next session", "wish.half_width": "Workspace, left and right",
  "wish.half_depth": "Workspace, near and far", "wish.low": "Workspace, lowest height",
  "wish.high": "Workspace, greatest height", "wish.speed": "Greatest speed of games",
});

// The support of the arm ----------------------------------------------------------------------

const UNWEIGHED = 15, OVER = 2; // [N] without a weight, and beyond it: bounds of the session's node

// The largest support [N] and why it is no more. weight: of the arm [N], null if it is not known.
export function supportLimit(weight, controller, drive) {
  const limits = [weight === null
    ? [UNWEIGHED, t("the arm is not weighed")] : [weight + OVER, t("the arm's weight and {0} N", OVER)]];
  if (controller) {
    const reason = controller.support_limit === 0 ? t("this mode feeds no force back: choose mode 3, 4 or 5")
      : drive && !drive.brakes ? t("at a stop the drive coasts, so the arm falls") : t("the robot carries no more");
    limits.push([controller.support_limit, reason]);
  }
  return limits.reduce((least, each) => (each[0] < least[0] ? each : least));
}

export function supportSentence(controller, most, reason) {
  if (!controller) return t("The vertical axis is silent.");
  if (controller.hand_off) return t("The hand has left the handle: the support is away until it is back.");
  return t("In use {0}, at most {1}: {2}.", newtons(controller.support), newtons(most), reason);
}

// The button of the dialogue that weighs the arm.
export function weighWords(state) {
  if (!isWeighed(state)) return t("Weigh the arm");
  return state.phase === WAIT ? t("Strapped in: go on") : t("End the weighing");
}

// What the arm weighs, and what the dialogue that weighs it waits for or has found.
export function armSentence(state) {
  if (!state) return "";
  const { arm_weight: weight, arm_spread: spread } = state, arm = said(state.arm);
  if (arm) return `${arm[0].toUpperCase()}${arm.slice(1)}.`;
  return weight === null ? t("The arm is not weighed.") : t("The arm weighs {0}; its places differ by {1}.", newtons(weight), newtons(spread));
}

// What the software stop does to the arm.
export function stopSays(drive) {
  return drive?.brakes ? t("torque off: the arm sinks, then falls") : t("torque off: the arm falls");
}

export function robotTitle(robot) {
  return t("Robot {0}", robot.slice(1));
}

export function stopFailed(why) {
  return t("The software stop failed: {0}. Use the emergency stop.", why);
}

// What stands beside Start; count: of the sessions recorded so far.
export function sessionOf(count) {
  return count ? t("session {0}", count + 1) : t("first session");
}

// next: what is planned for him, undefined for nothing.
export function again(patient, next) {
  return next ? t("{0}, next: {1}", patient, said(next.title)) : t("{0} again", patient);
}

export function remove({ title }) {
  return t("Take {0} out of the plan", said(title));
}

// left: of the session [min], null if that is not known; planned: all that is planned after it [min].
export function leftWords(left, planned) {
  if (left === null) return "";
  return planned ? t("About {0} left, {1} with the plan.", minutesWords(left), minutesWords(left + planned)) : t("About {0} left.", minutesWords(left));
}

export function patientSound(isOn) {
  return isOn ? t("Patient's sound: on") : t("Patient's sound: off");
}

export function wasSet(name) {
  return t("{0}: set.", LIMITS[name]);
}

// reaches, alone: results of the reaches, and of those without assistance.
export function resultSentence(patient, reaches, alone) {
  const isApart = alone.length && alone.length < reaches.length;
  return isApart ? t("{0}: {1} targets reached, without assistance {2}", patient, counted(reaches), counted(alone))
    : t("{0}: {1} targets reached", patient, counted(reaches));
}

// rows: results of the minutes of a game.
export function playSentence(patient, rows) {
  const told = rows.map(({ score }) => score).filter((score) => score != null).map((score) => `${(100 * score).toFixed(0)} %`);
  return told.length ? t("{0}: {1} min of play, score {2}", patient, rows.length, told.slice(-SCORES).join(", "))
    : t("{0}: {1} min of play", patient, rows.length);
}

const SCORES = 6; // of the last minutes

function counted(reaches) {
  return t("{0} of {1}", reaches.filter(({ reached }) => reached).length, reaches.length);
}

// The assistance in use now.
export function assistanceSentence(state) {
  if (!isUnderWay(state)) return "";
  if (state.kind === "game") return t("Now: a game, without walls");
  const { assisted, duration, side_stiffness: side } = state;
  return assisted ? t("Now: {0} s a movement, side walls {1} N/m", duration.toFixed(2), side.toFixed(0)) : t("Now: without assistance");
}

export function changeSentence({ block, circuit, duration, side, reason }) {
  return t("Block {0}, circuit {1}: {2} s, side walls {3} N/m; {4}", block, circuit, duration.toFixed(2), side.toFixed(0), said(reason));
}

const PHASES = {
  [PREPARE]: t("the robot brings the hand to the start and holds it there"), [WAIT]: t("the target is shown"),
  [MOVING]: t("the patient moves"), [OVER_TIME]: t("over time, the wall stiffens slowly"),
  [REACHED]: t("reached"),
};

function localTime(date) {
  return date.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit", timeZoneName: "short" });
}

// Where the session is, in one sentence; since: when that began, a Date, null if this page has not seen it.
export function sessionSentence(state, protocols, since = null) {
  if (!state) return t("The session node is silent.");
  const at = since ? t(", at {0}", localTime(since)) : "";
  const title = said(protocols.find(({ protocol }) => protocol === state.protocol)?.title ?? state.protocol);
  const reason = said(state.reason);
  const kept = state.recorded ? t("It is recorded.") : t("It is not recorded.");
  const isGame = state.kind === "game";
  const count = isGame ? t("{0}, minute {1} of {2}", said(state.block), state.trial, state.trials)
    : t("movement {0} of {1}", state.trial, state.trials);
  switch (state.state) {
    case RUNNING: {
      const isAlone = state.phase === OVER_TIME && !state.assisted; // there is no wall
      const words = isGame ? t("the patient plays") : isAlone ? t("over time") : PHASES[state.phase];
      const phase = words ? `: ${words}` : "";
      return t("{0}: {1}. Running, {2}. {3}", state.patient, title, count + phase, kept);
    }
    case STARTING:
      if (state.asks) return t("{0}: {1}. Starting: the patient is asked on his screen; Resume goes on without.", state.patient, title);
      return t("{0}: {1}. Starting: {2}.", state.patient, title, reason);
    case PAUSED:
      if (isResting(state)) return t("{0}: {1}. {2}: a rest, {3} s left; Resume ends it. {4}", state.patient, title, count, whole(state.rest), kept);
      return t("{0}: {1}. Paused, {2}: {3}{4}. {5}", state.patient, title, count, reason, at, kept);
    case FINISHED:
      return isGame ? t("{0}. Finished: {1}, {2} min.", state.patient, title, state.trials)
        : t("{0}. Finished: {1}, {2} movements.", state.patient, title, state.trials);
    case ABORTED:
      return t("{0}: {1}. Ended before its time: {2}{3}.", state.patient, title, reason, at);
    default:
      return t("Press New for a pseudonym, choose arm and protocol, tick the list, press Start.");
  }
}

const ASKED = { 1: t("The patient is asked for pain on his screen."), 2: t("The patient is asked for tiredness on his screen.") };
const GO_ON = 1; // of TherapyState.goes_on

// What the patient has told of pain and tiredness, [sentence, whether the therapist is asked to go on].
export function askedSentence(state) {
  if (!state) return ["", false];
  const told = [state.pain != null && t("pain {0} of 10", state.pain), state.tired != null && t("tiredness {0} of 10", state.tired)]
    .filter(Boolean).join(", ");
  const isAsked = state.goes_on === GO_ON && isUnderWay(state);
  const now = ASKED[state.asks] ?? "";
  const tells = told && t("He tells {0}.", told);
  return [[now, tells, isAsked && !now ? t("Go on? Resume is yes, End session is no.") : ""].filter(Boolean).join(" "), isAsked];
}

const BADGES = {
  [RUNNING]: [`▶\ufe0e ${t("Running")}`, "running"], [STARTING]: [`… ${t("Starting")}`, "paused"],
  [PAUSED]: [`❚❚ ${t("Paused")}`, "paused"], [FINISHED]: [`✓ ${t("Finished")}`, ""], [ABORTED]: [`✕ ${t("Ended")}`, ""],
};

// The state at a glance, [sign and word, its kind].
export function badge(state, safety) {
  if (safety?.level === SAFETY_STOPPED) return [`■ ${t("Stopped")}`, "stopped"];
  if (safety?.level !== SAFETY_OK) return [`… ${t("Waiting")}`, "paused"];
  return BADGES[state?.state] ?? [`○ ${t("No session")}`, ""];
}

// What to hear of a change of the state, the name of a tone; "" for none. The therapist's own pause and a rest need none.
export function alarm(before, state, wasStopped, isStopped) {
  if (isStopped && !wasStopped) return "stopped";
  const isNew = state?.state === PAUSED && (before?.state !== PAUSED || before.reason !== state.reason);
  return isNew && !isResting(state) && state.reason !== "the therapist paused it" ? "paused" : "";
}

const HANGS = -8, CARRIES = 2, FLOOR = 0.03; // [N] of the arm on the handle, [N] that carry nothing, [m]

// Why a patient fails whose arm nothing carries, and the way out; "" for any other.
export function hangsSentence(state, endpoint, space) {
  if (!isUnderWay(state) || space === "plane" || !endpoint?.valid[2] || Math.abs(state.support) > CARRIES) return "";
  const isLow = endpoint.position.z < FLOOR;
  if (!isLow && endpoint.force.z > HANGS) return "";
  return isLow ? t("The arm has sunk to the bottom, and nothing carries it: pause, weigh the arm and give support.")
    : t("The arm hangs on the handle, and nothing carries it: pause, weigh the arm and give support.");
}

// What to do after a stop. Only an operator resets it: no page has that right.
function wayOut(state) {
  const isOn = isUnderWay(state);
  const after = isOn ? t("Resume, which repeats the movement, or End session") : PAGE.start;
  return t("See to the patient first. This page cannot start the robot again: ask its operator to remove the cause, reset the stop and switch the torque on at the robot's computer. Then press {0}.", after);
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
  if (!safety) return [t("The supervisor says nothing: no motion is permitted."), true];
  const told = safety.reasons.map((each) => (each === ESTOP ? t("the software stop was asked for") : said(each)));
  const reasons = told.join("; ") || t("no reason told");
  if (safety.level === SAFETY_STOPPED) {
    return [t("The robot has stopped: {0}. {1}", reasons, wayOut(state)), true];
  }
  if (safety.level !== SAFETY_OK) return [t("Waiting: {0}.", reasons), true];
  if (!endpoint) return [t("The robot's position is silent."), true];
  const off = [[t("plane"), 0], [t("vertical"), 1]].filter(([, i]) => !endpoint.enabled[i]);
  if (off.length) return [t("The torque is off: {0}.", off.map(([name]) => name).join(t(" and "))), true];
  return [t("The robot is ready, the torque is on."), false];
}

// The record of the patients -----------------------------------------------------------------

export const RECORD = table({
  title: "Patients", all: "All patients", back: "Back", wait: "One moment …",
  columns: ["Pseudonym", "Arm", "Last seen", "Sessions", "Due", "Proposed for the next session"],
  none: "No session has been recorded.", other: "Another pseudonym", open: "Open", withClosed: "also closed ones",
  side: "Arm", close: "Mark as closed", reopen: "Mark as open", print: "Print", save: "Save",
  exports: "Export", forget: "Forget", report: "Report",
  sessions: "Sessions", sessionColumns: ["#", "Begun", "Protocol", "Arm", "Movements", "Course", "Support", ""],
  scores: "Scores", scoreColumns: ["When", "Scale", "Value"], scale: "Scale", value: "Value", when: "When", now: "now", keep: "Keep",
  noProgress: "There is no session with a date, so there is no progress to show.",
  statement: "It describes recorded movements: no diagnosis, and no benefit of a therapy is claimed.",
  exportSays: "Trials, sessions and scores as CSV files, with units and what each column means. The file that is saved is personal data: keep it safe.",
  shift: "move all dates by one random number of days", rename: "give a new pseudonym, which nothing keeps", download: "Save the file",
  deleted: "To be deleted for good:", rows: "rows of the record, scores, the weights of the arms",
  unreached: "Not reached, so it stays unless you see to it:", again: "Write the pseudonym again",
});

// What was last time of a patient who is known, "" where nothing was; isSet: it is to be so again, title: of its protocol.
export function asLastTime(about, isSet = false, title = about.protocol) {
  const parts = [about.side && t("{0} arm", sideWords(about.side)), said(title), about.level && said(about.level), proposal(about)].filter(Boolean).join(", ");
  if (!parts) return "";
  return isSet ? t("From Start on as last time: {0}.", parts) : t("Last time: {0}.", parts);
}

export function countWords(about) {
  if (!about) return t("Nothing is known of this pseudonym.");
  const { sessions, seen } = about;
  const due = dueWords(about);
  return [sessions === 1 ? t("{0} session", sessions) : t("{0} sessions", sessions), seen && t("last seen {0}", moment(seen)),
    proposal(about) && t("next {0}", proposal(about)), due && t("due: {0}", due)].filter(Boolean).join("; ");
}

export function forgetTitle(name) {
  return t("Forget {0}", name);
}

export function forgotten() {
  return t("The patient was forgotten. Copies elsewhere are yours to delete.");
}
