// SPDX-License-Identifier: Apache-2.0
// One robot on the therapist's page.

import { named } from "../bridge.js";
import { el, say } from "../elements.js";
import { SAFETY_STOPPED } from "../states.js";
import { LimitsCard } from "./limits.js";
import { safetySentence, sessionSentence } from "./sentences.js";
import { StartCard } from "./start.js";
import { Traces } from "./traces.js";
import { TrialsCard } from "./trials.js";
import { Views } from "./views.js";

const SILENT_MS = 3000;
const LIMITS_MS = 5000; // another therapist's page may set them
const VIEW_MS = 30, TRACE_MS = 100; // who supervises needs no more pictures than these

export class RobotPanel {
  constructor(robot, config, bridge) {
    this.robot = robot;
    this.bridge = bridge;
    this.protocols = config.protocols;
    this.heard = {};
    const call = (service, args) => bridge.call(named(robot, service), args);
    this.sentence = el("p", { className: "state", role: "status" });
    this.reasons = el("p", { className: "reasons", role: "status" });
    this.stop = el("button", { type: "button", className: "stop", onclick: () => this.softwareStop() },
      "Software stop", el("small", {}, "(not the emergency stop)"));
    this.start = new StartCard(config.protocols, call);
    this.limits = new LimitsCard(call, (values) => { this.allowed = values; });
    this.views = new Views();
    this.traces = new Traces();
    this.trials = new TrialsCard();
    const title = config.robots.length > 1 ? `Robot ${robot.slice(1)}` : "Robot";
    this.element = el("article", { className: "robot", id: `robot${robot.replaceAll("/", "-")}` },
      el("section", { className: "card top" },
        el("div", {}, el("h2", {}, title), this.sentence, this.reasons), this.stop),
      this.start.element, this.views.element, this.traces.element, this.trials.element,
      this.limits.element);
    this.hear("endpoint_state", (message) => {
      this.views.take(message);
      this.traces.take(message);
    });
    this.hear("therapy/state", (message) => {
      this.start.show(message, this.isStopped());
      this.trials.follow(message);
    });
    this.hear("safety_state");
    this.hear("therapy/trial", (message) => this.trials.take(message));
    this.hear("therapy/assistance", (message) => this.trials.takeChange(message));
    this.drawn = this.viewed = this.refreshed = 0;
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
    this.start.tell("Software stop asked for …");
    try {
      const { success, message } = await this.bridge.call(named(this.robot, "supervisor/estop"));
      if (!success) throw new Error(message);
      this.start.tell("The software stop was carried out. What to do now stands beside its button.");
    } catch (error) {
      this.start.tell(`The software stop failed: ${error.message}. Use the emergency stop.`);
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
    say(this.sentence, sessionSentence(state, this.protocols));
    const [reason, isBad] = safetySentence(this.newest("safety_state"), endpoint, state);
    say(this.reasons, reason);
    this.reasons.classList.toggle("bad", isBad);
    const shown = this.protocols.find(({ protocol }) => protocol === state?.protocol);
    this.trials.show();
    this.views.draw(endpoint, state, this.allowed, shown);
    if (now - this.drawn > TRACE_MS) {
      this.drawn = now;
      this.traces.draw();
    }
  }
}
