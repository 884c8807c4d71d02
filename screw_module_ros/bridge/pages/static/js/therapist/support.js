// SPDX-License-Identifier: Apache-2.0
// The support of the arm's weight: what it weighs, how much of it the robot carries, and the dialogue
// that finds it out. The session's node bounds what is asked for; the controller what is in use.

import { supportShare } from "../cells.js";
import { el, say } from "../draw.js";
import { said } from "../language.js";
import { RUNNING, STARTING, isUnderWay, isWeighed } from "../link.js";
import { PAGE, armSentence, failure, supportLimit, supportSentence, weighWords } from "../words.js";
import { FORCE, setParameter } from "./parameters.js";

const SHARE = 0.05; // a step of the slider, of the arm's weight
const UNWEIGHED_STEP = 1; // [N] without one
const ROUNDED = 1e-3; // [N] the last step may end a little beyond the limit, as numbers are rounded

export class SupportCard {
  // call(service, args): a service of this robot; whose(): { patient, side } of the form.
  constructor(call, whose) {
    this.call = call;
    this.whose = whose;
    this.held = null; // another object each time the slider is taken; null once its value is answered
    this.shown = el("output");
    this.input = el("input", { type: "range", min: 0, max: 0, ariaLabel: PAGE.support });
    this.input.oninput = () => {
      this.held = {};
      this.share();
    };
    this.input.onchange = () => this.set(Number(this.input.value));
    this.use = el("p", { className: "use" });
    this.arm = el("p", { className: "arm", role: "status" });
    this.weigh = el("button", { type: "button", onclick: () => this.ask("therapy_session/weigh", this.whose()) });
    this.lower = el("button", { type: "button", onclick: () => this.ask("therapy_session/lower") },
      PAGE.lower, el("small", {}, PAGE.lowers));
    this.told = el("p", { className: "told", role: "status" });
    this.element = el("section", { className: "card support" }, el("h2", {}, PAGE.support),
      el("label", { className: "limit" }, el("span", {}, PAGE.carried), this.input, this.shown), this.use,
      el("div", { className: "row" }, this.weigh, this.lower), this.arm, this.told);
    this.show(null, null, null);
  }

  // state: of the session; controller, drive: of the vertical axis; null where they are silent.
  show(state, controller, drive) {
    this.weight = state?.arm_weight ?? null;
    const [most, reason] = supportLimit(this.weight, controller, drive);
    this.input.disabled = !state || isWeighed(state);
    if (!this.held && state) {
      this.input.step = this.weight ? SHARE * this.weight : UNWEIGHED_STEP;
      this.input.max = Math.max(most, state.support) + ROUNDED;
      this.input.value = state.support;
    }
    this.share();
    say(this.use, supportSentence(controller, most, reason));
    say(this.arm, armSentence(state));
    say(this.weigh, weighWords(state));
    this.weigh.disabled = !state || isUnderWay(state);
    this.lower.disabled = !state || isWeighed(state) || [RUNNING, STARTING].includes(state.state);
  }

  share() {
    say(this.shown, supportShare(Number(this.input.value), this.weight));
  }

  async set(value) {
    const { held } = this;
    await this.telling(async () => {
      await setParameter(this.call, FORCE, value);
      return { success: true };
    });
    if (this.held === held) this.held = null; // else the slider was taken again in between
  }

  ask(service, args = {}) {
    return this.telling(() => this.call(service, args));
  }

  async telling(act) {
    try {
      const { success, message } = await act();
      say(this.told, success ? "" : said(message)); // what comes next stands in the state
    } catch (error) {
      say(this.told, failure(error));
    }
  }
}
