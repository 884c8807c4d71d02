// SPDX-License-Identifier: Apache-2.0
// The patient's screen: shows what the session asks for; while none runs, there is a game.

import { Bridge, chosenRobot, configurationAtLast, named } from "../bridge.js";
import { fitted } from "../canvas.js";
import { ABORTED, FINISHED, IDLE, RUNNING, SAFETY_OK } from "../states.js";
import { ownToken } from "../token.js";
import { drawClock } from "./clock.js";
import { Count } from "./count.js";
import { drawElevator } from "./elevator.js";
import { FruitGame } from "./fruit.js";
import { Sound } from "./sound.js";
import { drawSpace } from "./space.js";
import { task, veil } from "./words.js";

const SCENES = { plane: drawClock, vertical: drawElevator, space: drawSpace };
const SILENT_MS = 1500;
const TOLD_MS = 3000; // a session tells its state at 20 Hz
const WISH_MS = 60;
const AFTER_MS = 8000; // how long the end of a session is shown
const FREE = { phase: 0, start: { x: 0, y: 0, z: 0.18 }, target: { x: 9, y: 9, z: 9 }, kind: "" };

const $ = (id) => document.getElementById(id);
const canvas = $("picture");
const sound = new Sound();
const world = {
  hand: { x: 0, y: 0, z: null, isKnown: false }, // isKnown: in the plane; z: null where it is not
  force: { x: 0, y: 0, z: 0 },
  state: null, protocol: null, safety: SAFETY_OK, isOpen: false, sentence: "",
  heardAt: -Infinity, stateAt: -Infinity, toldAt: -Infinity, trials: 0,
};
const seen = new Count();
let play = null; // the FruitGame, "free", or null: the menu
let bridge, config, robot;
let lastFrame = 0, lastWish = 0, frames = [];

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
  }
  if (seen.take(state, before, isNew)) sound.play("reached");
  world.trials = state.trials;
  world.state = state;
}

function isInSession() {
  const { state } = world;
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
  if (inSession) SCENES[world.protocol?.space ?? "plane"](picture, world);
  else drawPlay(picture, dt, now, isHeard);
  showWords(inSession, isHeard, now - world.toldAt < TOLD_MS);
  count(now);
  requestAnimationFrame(frame);
}

function drawPlay(picture, dt, now, isHeard) {
  const { hand } = world;
  if (play instanceof FruitGame) {
    const point = hand.isKnown ? [hand.x, hand.y, hand.z ?? 0.18] : null;
    if (isHeard && world.safety === SAFETY_OK) play.step(dt, point);
    play.draw(picture, point);
    const wish = play.wish(point);
    if (wish && config.wishes && now - lastWish > WISH_MS) {
      lastWish = now;
      const [x, y, z] = wish;
      bridge.publish(named(robot, "therapy/wish"), { position: { x, y, z } });
    }
  } else {
    drawSpace(picture, { ...world, state: FREE, protocol: null });
  }
}

function showWords(inSession, isHeard, isTold) {
  const { reached, hasSeenAll, hasOthers } = seen;
  const state = inSession ? world.state : null;
  const over = veil({ ...world, state, isHeard, isTold, reached, hasSeenAll, hasOthers });
  $("veil").hidden = !over;
  if (over) put($("veil").children, over);
  const running = inSession && world.state.state === RUNNING;
  $("menu").hidden = Boolean(over) || inSession || play !== null;
  $("back").hidden = inSession || play === null;
  put([$("task")], [running && !over ? task(world.state) : ""]);
  $("progress").hidden = !running;
  if (running) {
    const share = (100 * (world.state.trial - 1)) / Math.max(world.state.trials, 1);
    $("progress").firstElementChild.style.width = `${share}%`;
    $("progress").setAttribute("aria-valuenow", Math.round(share));
  }
  const shown = over ? "veil" : inSession ? world.protocol?.space ?? "plane" : play ? "play" : "menu";
  Object.assign(document.body.dataset, {
    shown, trial: world.state?.trial ?? 0, score: play?.score ?? 0,
  });
}

function put(elements, words) {
  words.forEach((word, i) => {
    if (elements[i].textContent !== word) elements[i].textContent = word;
  });
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

function makeButtons() {
  $("sound").onclick = () => {
    const isOn = sound.toggle();
    $("sound").textContent = `Sound: ${isOn ? "on" : "off"}`;
    $("sound").setAttribute("aria-pressed", isOn);
  };
  $("back").onclick = () => choose(null);
  $("full").onclick = () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen?.().catch(() => {});
  };
  for (const [id, words, make] of [
    ["fruit", "Pick fruit", () => new FruitGame()], ["free", "Move freely", () => "free"],
  ]) {
    const button = document.createElement("button");
    Object.assign(button, { id, type: "button", textContent: words });
    button.onclick = () => choose(make());
    $("choices").append(button);
  }
}

async function main() {
  makeButtons();
  requestAnimationFrame(frame);
  const token = ownToken();
  config = await configurationAtLast(token, (sentence) => { world.sentence = sentence; });
  const asked = new URLSearchParams(location.search).get("robot");
  robot = chosenRobot(config.robots, asked);
  if (!robot) {
    world.sentence = `There is no robot ${asked} here: ask for the right address.`;
    return;
  }
  bridge = new Bridge(token, (isOpen, sentence) => {
    Object.assign(world, { isOpen, sentence });
    if (!isOpen) seen.miss();
  });
  bridge.subscribe(named(robot, "endpoint_state"), hearEndpoint);
  bridge.subscribe(named(robot, "therapy/state"), hearState);
  bridge.connect();
}

main().catch(() => {}); // the sentence is on the screen
