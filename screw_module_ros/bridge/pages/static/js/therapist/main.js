// SPDX-License-Identifier: Apache-2.0
// The therapist's page: one panel per robot.

import { Awake } from "../awake.js";
import { el, say } from "../draw.js";
import { Bridge, SAFETY_STOPPED, configurationAtLast, named, ownToken, tellPresses } from "../link.js";
import { changeLanguage, language, said } from "../language.js";
import { Desk } from "../record/desk.js";
import { Sound } from "../sound.js";
import {
  PAGE, alarm, badge, hangsSentence, failure, robotTitle, safetySentence, sessionSentence, stopFailed, stopSays, unready,
} from "../words.js";
import { Traces, Views } from "./charts.js";
import { LimitsCard } from "./limits.js";
import { MachineCard } from "./machine.js";
import { MovementsCard } from "./movements.js";
import { SessionCard } from "./session.js";
import { SupportCard } from "./support.js";

const SILENT_MS = 3000, HANGS_MS = 2000;
const LIMITS_MS = 5000; // another therapist's page may set them
const VIEW_MS = 30, TRACE_MS = 100; // who supervises needs no more pictures than these

function column(...cards) {
  return el("div", { className: "column" }, ...cards.map(({ element }) => element));
}

export class RobotPanel {
  constructor(robot, config, bridge, recalled) {
    this.robot = robot;
    this.bridge = bridge;
    this.protocols = config.protocols;
    this.heard = {};
    const call = (service, args) => bridge.call(named(robot, service), args);
    this.sentence = el("p", { className: "state", role: "status" });
    this.badge = el("p", { className: "badge" });
    this.reasons = el("p", { className: "reasons", role: "status" });
    this.stop = el("button", { type: "button", className: "stop", onclick: () => this.softwareStop() },
      PAGE.stop, el("small", {}, PAGE.notEmergency), this.stops = el("small"));
    this.session = new SessionCard(config.protocols, call, recalled);
    this.support = new SupportCard(call, () => this.session.whose());
    this.limits = new LimitsCard(call, (values) => { this.allowed = values; });
    this.views = new Views();
    this.traces = new Traces();
    this.machine = new MachineCard();
    this.movements = new MovementsCard(config.measures);
    this.element = el("article", { className: "robot", id: `robot${robot.replaceAll("/", "-")}` },
      el("section", { className: "card top" },
        el("div", { className: "about" }, ...(config.robots.length > 1 ? [el("h2", {}, robotTitle(robot))] : []),
          this.badge, this.sentence, this.reasons), this.stop),
      column(this.session, this.limits), column(this.views, this.traces), column(this.support, this.machine, this.movements));
    tellPresses(this.element, (topic, message) => bridge.publish(named(robot, topic), message));
    this.hear("endpoint_state", (message) => {
      this.views.take(message);
      this.traces.take(message);
    });
    this.hear("therapy/state", (message) => this.movements.follow(message));
    this.was = [null, false];
    this.hear("safety_state");
    this.hear("screw/controller_state");
    this.hear("screw/amplifier_state");
    this.hear("therapy/trial", (message) => this.movements.take(message));
    this.hear("therapy/assistance", (message) => this.movements.takeChange(message));
    this.drawn = this.viewed = this.refreshed = this.sankAt = 0;
  }

  hear(topic, more = () => {}) {
    this.bridge.subscribe(named(this.robot, topic), (message) => {
      this.heard[topic] = { message, at: performance.now() };
      more(message);
    });
  }

  // The newest message of a topic, null where it is silent.
  newest(topic) {
    const { message, at } = this.heard[topic] ?? { at: -Infinity };
    return performance.now() - at < SILENT_MS ? message : null;
  }

  isStopped() {
    return this.newest("safety_state")?.level === SAFETY_STOPPED;
  }

  async softwareStop() {
    this.session.tell(PAGE.stopping);
    try {
      const { success, message } = await this.bridge.call(named(this.robot, "supervisor/estop"));
      if (!success) throw new Error(message);
      this.session.tell(PAGE.stopped);
    } catch (error) {
      this.session.tell(stopFailed(failure(error)));
    }
  }

  // Tells that somebody is at this page: a session that misses it pauses.
  attend() {
    this.bridge.publish(named(this.robot, "therapy/attendance"), {});
    if (!this.bridge.isOpen || performance.now() - this.refreshed < LIMITS_MS) return;
    this.refreshed = performance.now();
    this.limits.refresh();
  }

  draw(now) {
    if (now - this.viewed < VIEW_MS) return;
    this.viewed = now;
    const [endpoint, state] = [this.newest("endpoint_state"), this.newest("therapy/state")];
    const [drive, controller] = [this.newest("screw/amplifier_state"), this.newest("screw/controller_state")];
    const safety = this.newest("safety_state");
    // Drawn with the sentences, whichever topic came last: no button contradicts what they say.
    this.session.show(this.heard["therapy/state"]?.message, this.isStopped(),
      unready(safety, endpoint, controller, state, this.session.space));
    this.support.show(state, controller, drive);
    this.limits.show(state);
    say(this.stops, stopSays(drive));
    const [was] = this.was;
    if (!was || !state) this.since = null;
    else if (was.state !== state.state || was.reason !== state.reason) this.since = new Date();
    say(this.sentence, sessionSentence(state, this.protocols, this.since));
    const [word, kind] = badge(state, safety);
    say(this.badge, word);
    this.word = word;
    const tone = alarm(this.was[0], state, this.was[1], this.isStopped());
    if (tone) sound.play(tone);
    this.was = [state, this.isStopped()];
    this.badge.className = `badge ${kind}`;
    const shown = this.protocols.find(({ protocol }) => protocol === state?.protocol);
    const [reason, isBad] = safetySentence(safety, endpoint, state);
    const hangs = isBad ? "" : hangsSentence(state, endpoint, shown?.space ?? "plane");
    if (!hangs) this.sankAt = now; // who only pushes down for a moment does not hang
    const isHanging = now - this.sankAt > HANGS_MS;
    say(this.reasons, isHanging ? hangs : reason);
    this.reasons.classList.toggle("bad", isBad || isHanging);
    this.movements.show();
    this.views.draw(endpoint, state, this.allowed, shown);
    if (now - this.drawn > TRACE_MS) {
      this.drawn = now;
      this.traces.draw();
      this.machine.draw(endpoint);
    }
  }
}

const ATTEND_MS = 500; // a session pauses after 2 s without
const $ = (id) => document.getElementById(id);
let panels = [];
const sound = new Sound(true);

function notice(sentence) {
  $("notice").hidden = !sentence;
  say($("notice"), sentence);
}

function connected(isOpen, sentence) {
  document.body.dataset.open = isOpen;
  say($("connection"), isOpen ? PAGE.connected : PAGE.unconnected);
  notice(said(sentence) || (isOpen ? "" : PAGE.lost));
  if (isOpen) for (const panel of panels) panel.limits.load();
}

function frame(now) {
  for (const panel of panels) panel.draw(now);
  const words = panels.map(({ word }) => word).filter(Boolean);
  if (words.length) document.title = `${words.join(" · ")} – ${PAGE.title}`;
  requestAnimationFrame(frame);
}

async function main() {
  say($("title"), PAGE.title);
  say($("patients"), PAGE.patients);
  document.documentElement.lang = language;
  say($("language"), language === "de" ? "English" : "Deutsch");
  $("language").onclick = changeLanguage;
  say($("sounds"), PAGE.soundsOn);
  $("sounds").onclick = () => {
    sound.set(!sound.isOn);
    say($("sounds"), sound.isOn ? PAGE.soundsOn : PAGE.soundsOff);
  };
  sound.listen();
  new Awake((isHeld) => say($("dims"), isHeld ? "" : PAGE.dims)).ask();
  say($("connection"), PAGE.connecting);
  const token = ownToken();
  const config = await configurationAtLast(token, (error) => notice(failure(error)));
  if (config.role !== "therapist") {
    notice(PAGE.wrongRole);
    return;
  }
  notice("");
  const bridge = new Bridge(token, connected);
  const desk = new Desk(token);
  const recalled = async (patient) => (await desk.json(`${patient}/patient`)).about;
  panels = config.robots.map((robot) => new RobotPanel(robot, config, bridge, recalled));
  $("robots").classList.toggle("several", panels.length > 1);
  $("robots").append(...panels.map((panel) => panel.element));
  bridge.connect();
  setInterval(() => panels.forEach((panel) => panel.attend()), ATTEND_MS);
  requestAnimationFrame(frame);
}

main().catch(() => {}); // the sentence is on the page
