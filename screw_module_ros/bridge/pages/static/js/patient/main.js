// SPDX-License-Identifier: Apache-2.0
// The patient's screen: shows what the session asks for; while none runs, there is a game.

import { Awake, makeFullScreen } from "../awake.js";
import { drawHand, el, fitted, say } from "../draw.js";
import {
  ABORTED, Bridge, FINISHED, IDLE, REACHED, RUNNING, SAFETY_OK, STARTING, chosenRobot, configurationAtLast,
  isPlayed, isResting, isUnderWay, isWeighed, named, ownToken, tellPresses,
} from "../link.js";
import { Sound } from "../sound.js";
import { SCREEN, failure, noRobot, task, veil } from "../words.js";
import { FramedGame } from "./framed.js";
import { FruitGame, drawApple } from "./fruit.js";
import { changeLanguage, chosenLanguage } from "./languages.js";
import { SCENES, drawSign } from "./scenes.js";

function placeOf(place) {
  return [place?.x, place?.y, place?.z ?? 0].map((value) => Math.round(1000 * value)).join();
}

// Counts the targets that this screen has seen reached in a session. One that came late, or lost its
// connection, has not seen all and must not tell a number.
export class Count {
  constructor() {
    this.begin(false);
  }

  begin(hasSeenAll) {
    this.trials = new Set(); // a trial that was paused after its target is done again
    this.places = new Map(); // how often each target was reached
    this.hasSeenAll = hasSeenAll;
    this.hasOthers = false; // trials without a target: circles, holding, pushing
  }

  get reached() {
    return this.trials.size;
  }

  // How often a target was reached, by its place [m].
  times(place) {
    return this.places.get(placeOf(place)) ?? 0;
  }

  // Takes a message of therapy/state, with the one before or null; returns whether a target has
  // been reached just now. isOther: it is of another patient or protocol.
  take(state, before, isOther) {
    const wasOn = isUnderWay(before);
    if (isOther) this.begin(state.trial === 1);
    else if (state.trial === 1 && state.state === RUNNING && !(wasOn && before.trial === 1)) this.begin(true);
    if (state.state === RUNNING && state.kind && state.kind !== "reach") this.hasOthers = true;
    const isSame = before?.phase === REACHED && before.trial === state.trial;
    const isReached = state.phase === REACHED && !isSame;
    if (isReached && !this.trials.has(state.trial)) {
      this.trials.add(state.trial);
      this.places.set(placeOf(state.target), this.times(state.target) + 1);
    }
    return isReached;
  }

  miss() {
    this.hasSeenAll = false;
  }
}

const SILENT_MS = 1500;
const TOLD_MS = 3000; // a session tells its state at 20 Hz
const WISH_MS = 60, SCORE_MS = 500;
const AFTER_MS = 8000; // how long the end of a session is shown
const BLOOM_MS = 500; // how long a flower opens
const BESIDE_STOP = 0.38; // of the width: the button is in the corner
const FREE = { phase: 0, start: { x: 0, y: 0, z: 0.18 }, kind: "" };

const $ = (id) => document.getElementById(id);
const canvas = $("picture");
const sound = new Sound();
const world = {
  hand: { x: 0, y: 0, z: null, isKnown: false }, // isKnown: in the plane; z: null where it is not
  force: { x: 0, y: 0, z: 0 },
  state: null, protocol: null, safety: SAFETY_OK, isOpen: false, sentence: "",
  heardAt: -Infinity, stateAt: -Infinity, toldAt: -Infinity, reachedAt: -Infinity, trials: 0,
  seen: new Count(), bloom: 1, side: "right", isStopping: false, told: "",
  answered: 0, answeredAt: -Infinity,
};
const { seen } = world;
let play = null; // the FruitGame, "free", or null: the menu
let game = null, played = ""; // that a session plays, and which one that is
let bridge, config, robot;
let stillness = { matches: false }; // whether who looks has asked for little motion
let lastFrame = 0, lastWish = 0, lastScore = 0, frames = [];

function hearEndpoint(message) {
  const { position, valid, force, safety } = message;
  Object.assign(world.hand, position, { isKnown: valid[0] && valid[1] });
  world.force = force;
  world.safety = safety;
  world.heardAt = performance.now();
}

function hearState(state) {
  const before = world.state;
  world.toldAt = performance.now();
  if (before && state.state !== before.state) world.stateAt = performance.now();
  // A page gets the newest state alone: between two sessions there may be none that says so.
  const isNew = before && (state.patient !== before.patient || state.protocol !== before.protocol);
  if (state.state === RUNNING && (before?.state !== RUNNING || isNew)) {
    world.protocol = config.protocols.find(({ protocol }) => protocol === state.protocol) ?? null;
    play = null;
    if (state.side) chooseHand(state.side);
  }
  followGame(state);
  if (seen.take(state, before, isNew)) {
    world.reachedAt = performance.now();
    sound.play("reached");
  }
  if (Boolean(state.sound) !== Boolean(before?.sound)) setSound(state.sound);
  world.trials = state.trials;
  world.state = state;
}

// Begins the game that a session plays, and ends it with the session; a pause leaves it as it is.
function followGame(state) {
  const asked = isPlayed(state) ? [state.patient, state.protocol, state.block].join() : "";
  if (asked === played) return;
  game?.close();
  [game, played] = [null, asked];
  if (!asked) return;
  const found = config.protocols.find(({ protocol }) => protocol === state.protocol) ?? {};
  const { levels = [], page = "fruit" } = found;
  const level = Math.max(levels.indexOf(state.block), 0) / Math.max(levels.length - 1, 1);
  game = page === "fruit" ? new FruitGame(Math.random, level) : new FramedGame(found);
  Object.assign(game, { level, basketAt: BESIDE_STOP });
  game.sound = (name) => sound.play(name);
}

function isInSession() {
  const { state } = world;
  if (isWeighed(state)) return true;
  if (!state || state.state === IDLE) return false;
  const over = state.state === FINISHED || state.state === ABORTED;
  return !over || (performance.now() - world.stateAt < AFTER_MS && !play);
}

function frame(now) {
  const dt = Math.min((now - lastFrame) / 1000, 0.1);
  lastFrame = now;
  const isHeard = now - world.heardAt < SILENT_MS;
  const picture = fitted(canvas);
  const inSession = isInSession();
  world.bloom = stillness.matches ? 1 : Math.min((now - world.reachedAt) / BLOOM_MS, 1);
  if (inSession && game) drawGame(game, picture, dt, now, isHeard && world.state.state === RUNNING);
  else if (inSession) SCENES[world.protocol?.space ?? "plane"](picture, world);
  else drawPlay(picture, dt, now, isHeard);
  showWords(inSession, isHeard, now - world.toldAt < TOLD_MS);
  count(now);
  requestAnimationFrame(frame);
}

function drawPlay(picture, dt, now, isHeard) {
  if (play instanceof FruitGame) drawGame(play, picture, dt, now, isHeard);
  else SCENES.space(picture, { ...world, state: FREE, protocol: null });
}

// isOn: the robot is heard, and no session waits.
function drawGame(shown, picture, dt, now, isOn) {
  const { hand, force, safety, side, state } = world;
  const point = hand.isKnown ? [hand.x, hand.y, hand.z ?? 0.18] : null;
  const plays = isOn && safety === SAFETY_OK;
  shown.isStill = stillness.matches;
  if (plays) shown.step(dt, point);
  shown.draw(picture, point, side);
  const { trial: minute, trials: minutes, since } = state ?? {};
  shown.tell({
    plays, hand: point, force: [force.x, force.y, force.z], side, level: shown.level, minute, minutes, since,
    isStill: shown.isStill, language: chosenLanguage(),
  });
  if (plays && config.wishes && now - lastWish > WISH_MS) {
    lastWish = now;
    const wish = shown.wish(point);
    if (wish) bridge.publish(named(robot, "therapy/wish"), { position: { x: wish[0], y: wish[1], z: wish[2] } });
  }
  if (shown !== game || !plays || since === null || now - lastScore < SCORE_MS) return;
  lastScore = now;
  const share = game.share(minute, since);
  if (share !== null) bridge.publish(named(robot, "therapy/score"), { data: share });
}

const AXES = { plane: ["x", "y"], vertical: ["z"], space: ["x", "y", "z"] };

// Whether the hand is at the start of the movement, on the axes that the protocol uses.
export function isAtStart({ hand, protocol, state }) {
  const ways = AXES[protocol?.space ?? "plane"].map((axis) => hand[axis] - state.start[axis]);
  return Math.hypot(...ways) <= state.hit_radius;
}

function showWords(inSession, isHeard, isTold) {
  const { reached, hasSeenAll, hasOthers } = seen;
  const state = inSession ? world.state : null;
  const over = veil({ ...world, state, isHeard, isTold, reached, hasSeenAll, hasOthers });
  $("veil").hidden = !over;
  if (over) {
    const [sign, ...words] = over;
    put($("veil").querySelectorAll("h1, p"), words);
    drawSign(fitted($("sign")), sign);
  }
  const running = inSession && world.state.state === RUNNING;
  $("menu").hidden = Boolean(over) || inSession || play !== null;
  $("language").hidden = inSession; // a reload there would lose the count of the targets
  $("back").hidden = inSession || play === null;
  showQuestion(world.isOpen && isTold);
  $("stop").hidden = !canStop();
  if (!canStop()) world.told = "";
  say($("task"), world.told ? world.told : over ? "" : running ? task(world.state, isAtStart(world)) : play === "free" ? SCREEN.freely : "");
  $("progress").hidden = !running;
  if (running) {
    const share = (100 * (world.state.trial - 1)) / Math.max(world.state.trials, 1);
    $("progress").firstElementChild.style.width = `${share}%`;
    $("progress").setAttribute("aria-valuenow", Math.round(share));
  }
  const shown = over ? "veil" : inSession && !game ? world.protocol?.space ?? "plane" : game || play ? "play" : "menu";
  Object.assign(document.body.dataset, {
    shown, trial: world.state?.trial ?? 0, score: (game ?? play)?.score ?? 0,
  });
}

// Whether there is something that the patient can stop: a pause is all that his button asks for.
function canStop() {
  return isWeighed(world.state) || isResting(world.state) || [STARTING, RUNNING].includes(world.state?.state);
}

async function pleaseStop() {
  if (!canStop() || world.isStopping) return;
  world.isStopping = true;
  try {
    const { success } = await bridge.call(named(robot, "therapy_session/pause_by_patient"));
    world.told = success ? "" : SCREEN.unheard;
  } catch {
    world.told = SCREEN.unheard;
  }
  world.isStopping = false;
}

const AGAIN_MS = 2000; // an answer may be lost
const ANSWER = 16; // an answer is 16 times the question, and the number

// Asks for pain or tiredness, over all else, while the session's node says so.
function showQuestion(isOpen) {
  const asks = isOpen ? world.state?.asks ?? 0 : 0;
  $("ask").hidden = !SCREEN.questions[asks];
  if ($("ask").hidden) return;
  put($("ask").querySelectorAll("h1, span"), SCREEN.questions[asks]);
  const isAnswered = world.answered === asks && performance.now() - world.answeredAt < AGAIN_MS;
  for (const button of $("numbers").children) button.disabled = isAnswered;
}

function answer(value) {
  Object.assign(world, { answered: world.state.asks, answeredAt: performance.now() });
  bridge.publish(named(robot, "therapy/answer"), { data: ANSWER * world.state.asks + value });
}

function put(elements, words) {
  words.forEach((word, i) => say(elements[i], word));
}

// Frames of the last second, for tests and for the curious (document.body.dataset.fps).
function count(now) {
  frames.push(now);
  while (frames[0] < now - 1000) frames.shift();
  document.body.dataset.fps = frames.length;
}

function choose(game) {
  play = game;
  if (play instanceof FruitGame) play.sound = (name) => sound.play(name);
}

// Which hand the picture shows, as whoever sets up the screen has chosen; kept for this tab only, since
// it tells something of the patient.
function chooseHand(side) {
  world.side = side;
  sessionStorage.setItem("hand", side);
  say($("hand"), SCREEN.hands[side]);
  drawChoices();
}

function drawChoices() {
  for (const { id, firstElementChild: icon } of $("choices").children) {
    const { width, height } = icon;
    const ctx = icon.getContext("2d");
    ctx.clearRect(0, 0, width, height);
    if (id === "free") drawHand(ctx, width / 2, height / 2, 0.42 * height, world.side);
    else drawApple(ctx, width / 2, height / 2, 0.42 * height);
  }
}

// Whoever switched it last counts: the patient here, or the therapist, whom the session's state tells.
function setSound(isOn) {
  sound.set(isOn);
  say($("sound"), isOn ? SCREEN.soundOn : SCREEN.soundOff);
  $("sound").setAttribute("aria-pressed", isOn);
}

function makeButtons() {
  canvas.setAttribute("aria-label", SCREEN.picture);
  $("progress").setAttribute("aria-label", SCREEN.progress);
  for (const id of ["back", "full", "hint", "stop"]) say($(id), SCREEN[id]);
  document.documentElement.lang = chosenLanguage();
  say($("language"), SCREEN.other);
  $("language").onclick = changeLanguage;
  say($("sound"), SCREEN.soundOff);
  say($("menu").querySelector("h1"), SCREEN.menu);
  $("sound").onclick = () => setSound(!sound.isOn);
  for (let value = 0; value <= 10; value++) {
    $("numbers").append(el("button", { type: "button", onclick: () => answer(value) }, String(value)));
  }
  $("back").onclick = () => choose(null);
  $("stop").onclick = pleaseStop;
  document.addEventListener("keydown", (event) => { // any key, as a button on USB is a keyboard
    if (!canStop()) return;
    event.preventDefault();
    pleaseStop();
  });
  makeFullScreen($("full"));
  for (const [id, make] of [
    ["fruit", () => new FruitGame()], ["free", () => "free"],
  ]) {
    const onclick = () => choose(make());
    const icon = el("canvas", { width: 240, height: 200 });
    $("choices").append(el("button", { id, name: id, type: "button", onclick }, icon, SCREEN[id]));
  }
  $("hand").onclick = () => chooseHand(world.side === "left" ? "right" : "left");
  chooseHand(sessionStorage.getItem("hand") === "left" ? "left" : "right");
}

async function main() {
  stillness = matchMedia("(prefers-reduced-motion: reduce)");
  makeButtons();
  sound.listen();
  new Awake((isHeld) => say($("dims"), isHeld ? "" : SCREEN.dims)).ask();
  requestAnimationFrame(frame);
  const token = ownToken();
  config = await configurationAtLast(token, (error) => { world.sentence = failure(error); });
  const asked = new URLSearchParams(location.search).get("robot");
  robot = chosenRobot(config.robots, asked);
  if (!robot) {
    world.sentence = noRobot(asked);
    return;
  }
  bridge = new Bridge(token, (isOpen, sentence) => {
    Object.assign(world, { isOpen, sentence });
    if (!isOpen) seen.miss();
  });
  bridge.subscribe(named(robot, "endpoint_state"), hearEndpoint);
  bridge.subscribe(named(robot, "therapy/state"), hearState);
  tellPresses(document, (topic, message) => bridge.publish(named(robot, topic), message));
  bridge.connect();
}

main().catch(() => {}); // the sentence is on the screen
