// SPDX-License-Identifier: Apache-2.0
// The form that starts a session, and the buttons that pause, resume and end it.

import { el, say } from "../elements.js";
import { PAUSED, RUNNING } from "../states.js";
import { PATTERN, cleaned, newPseudonym } from "./pseudonym.js";

export class StartCard {
  // call(service, args): a service of this robot.
  constructor(protocols, call) {
    this.call = call;
    this.protocols = protocols;
    this.patient = el("input", {
      className: "pseudonym", pattern: PATTERN, value: "P-", maxLength: 7, required: true,
      autocomplete: "off", spellcheck: false, ariaLabel: "Pseudonym of the patient",
    });
    this.patient.oninput = () => { this.patient.value = cleaned(this.patient.value); };
    this.new = el("button", { type: "button", onclick: () => this.fresh() }, "New");
    this.again = el("button", { type: "button", hidden: true, onclick: () => this.sameAgain() });
    this.protocol = el("select", { ariaLabel: "Protocol" }, ...protocols.map(
      ({ name, title, trials }) => el("option", { value: name }, `${title} (${trials})`)));
    this.record = el("input", { type: "checkbox", checked: true });
    this.start = el("button", { type: "submit", className: "primary" }, "Start");
    this.pause = this.button("Pause", "therapy_session/pause");
    this.resume = this.button("Resume", "therapy_session/resume");
    this.end = this.button("End session", "therapy_session/abort");
    this.save = this.button("Stop recording", "session_recorder/stop");
    this.told = el("p", { className: "told", role: "status" });
    const form = el("form", { onsubmit: (event) => this.submit(event) },
      el("div", { className: "row" },
        el("label", {}, "Pseudonym", this.patient), this.new, this.again,
        el("label", { className: "wide" }, "Protocol (movements)", this.protocol)),
      el("div", { className: "row" },
        el("label", { className: "check" }, this.record, "Record"), this.start, this.pause,
        this.resume, this.end, this.save));
    form.noValidate = true;
    this.element = el("section", { className: "card" }, el("h2", {}, "Session"), form, this.told);
    this.show(null);
  }

  button(words, service) {
    return el("button", { type: "button", onclick: () => this.ask(service) }, words);
  }

  fresh() {
    this.patient.value = newPseudonym();
    this.tell("Write down, elsewhere, whose pseudonym this is.", true);
  }

  sameAgain() {
    this.patient.value = this.last;
    this.again.hidden = true;
  }

  submit(event) {
    event.preventDefault();
    if (!this.patient.checkValidity()) {
      this.tell("A pseudonym like P-7K3QX is wanted: press New, or type it. No names.");
      return;
    }
    const [patient, protocol] = [this.patient.value, this.protocol.value];
    this.ask("therapy_session/start", { patient, protocol, record: this.record.checked });
  }

  async ask(service, args = {}) {
    this.tell("");
    try {
      const { success, message } = await this.call(service, args);
      this.tell(message, success);
    } catch (error) {
      this.tell(error.message);
    }
  }

  tell(sentence, isGood = false) {
    say(this.told, sentence);
    this.told.classList.toggle("good", isGood);
  }

  // isStopped: the robot has stopped, so that a session would pause again at once.
  show(state, isStopped = false) {
    const now = state?.state;
    const isOn = now === RUNNING || now === PAUSED;
    if (isOn) this.take(state);
    else if (this.isOn) this.clear();
    this.isOn = isOn;
    for (const each of [this.patient, this.new, this.protocol, this.record]) each.disabled = isOn;
    this.start.disabled = isOn || isStopped;
    this.pause.disabled = now !== RUNNING;
    this.resume.disabled = now !== PAUSED || isStopped;
    this.end.disabled = !isOn;
    this.save.disabled = !(now && state.recorded);
  }

  // Shows whose session runs, also on a page that was opened, or connected again, in its midst.
  take({ patient, protocol }) {
    this.patient.value = this.last = patient;
    this.again.hidden = true;
    const known = this.protocols.find((each) => each.protocol === protocol);
    if (known) this.protocol.value = known.name;
  }

  // After a session: the next patient's must not be kept under the pseudonym of the one before.
  clear() {
    this.patient.value = "P-";
    this.again.textContent = `${this.last} again`;
    this.again.hidden = false;
  }
}
