// SPDX-License-Identifier: Apache-2.0
// The form that starts a session, the buttons that pause, resume and end it, and pseudonyms.

import { SIDES } from "../cells.js";
import { el, say } from "../draw.js";
import { said } from "../language.js";
import { PAUSED, RUNNING, STARTING, isResting, isUnderWay } from "../link.js";
import { CHECKS, PAGE, again, asLastTime, askedSentence, failure, leftWords, sessionOf, toTick } from "../words.js";
import { FORCE, setParameter } from "./parameters.js";
import { Pace, Plan } from "./plan.js";

const ASK = 32; // of StartTherapy.checks
const MOST_MINUTES = 60; // of a game, as its file may have

// Pseudonyms, as therapy/pseudonym.py makes them: P- and five signs that look like no other,
// with a digit: else a name of five letters would be one.
const ALPHABET = "23456789ABCDEFGHJKMNPQRSTVWXYZ";
export const PATTERN = `P-(?=.*[2-9])[${ALPHABET}]{5}`;
const WHOLE = new RegExp(`^${PATTERN}$`);

export function newPseudonym() {
  const signs = [];
  while (signs.length < 5 || !signs.some((sign) => "2" <= sign && sign <= "9")) {
    if (signs.length === 5) signs.length = 0;
    const [byte] = crypto.getRandomValues(new Uint8Array(1));
    if (byte < ALPHABET.length * Math.floor(256 / ALPHABET.length)) {
      signs.push(ALPHABET[byte % ALPHABET.length]);
    }
  }
  return `P-${signs.join("")}`;
}

// What of a typed text may stand in the field: names and other free text do not get in.
export function cleaned(text) {
  const kept = text.toUpperCase().replace(/^P-?/, "");
  return `P-${[...kept].filter((sign) => ALPHABET.includes(sign)).slice(0, 5).join("")}`;
}

export class SessionCard {
  // call(service, args): a service of this robot; recalled(patient): a promise of what the record knows of one.
  constructor(protocols, call, recalled = async () => null) {
    this.call = call;
    this.recalled = recalled;
    this.protocols = protocols;
    this.patient = el("input", {
      className: "pseudonym", pattern: PATTERN, value: "P-", maxLength: 7, required: true,
      autocomplete: "off", spellcheck: false, ariaLabel: PAGE.patient,
    });
    this.patient.oninput = () => {
      this.patient.value = cleaned(this.patient.value);
      this.count();
    };
    this.new = el("button", { name: "fresh", type: "button", onclick: () => this.fresh() }, PAGE.fresh);
    this.again = el("button", { name: "again", type: "button", hidden: true, onclick: () => this.sameAgain() });
    const options = protocols.filter(({ levels }) => !levels).map(
      ({ name, title, trials }) => el("option", { value: name }, `${said(title)} (${trials})`));
    const games = protocols.filter(({ levels }) => levels).map(({ name, title }) => el("option", { value: name }, said(title)));
    this.protocol = el("select", { ariaLabel: PAGE.protocol, onchange: () => this.chooseAnother() }, ...options,
      ...(games.length ? [el("optgroup", { label: PAGE.games }, ...games)] : []));
    this.level = el("select", { ariaLabel: PAGE.level });
    this.minutes = el("input", { className: "minutes", type: "number", min: 1, max: MOST_MINUTES, ariaLabel: PAGE.minutes });
    this.shown = el("img", { className: "shown", alt: "" });
    this.game = el("div", { className: "row" }, el("label", { className: "level" }, PAGE.level, this.level),
      el("label", {}, PAGE.minutes, this.minutes), this.shown);
    this.plan = new Plan(() => this.item, (item) => this.propose(item));
    this.pace = new Pace();
    this.left = el("p", { className: "left" });
    [this.about, this.isAsLast] = [null, false];
    this.lastTime = el("button", { name: "last_time", type: "button", onclick: () => this.switchLastTime() }, PAGE.lastTime);
    this.side = el("select", { className: "side", ariaLabel: PAGE.armSide }, ...Object.entries(SIDES).map(
      ([value, words]) => el("option", { value }, words)));
    this.record = el("input", { type: "checkbox", checked: true });
    this.asks = el("input", { type: "checkbox", checked: true });
    this.start = el("button", { type: "submit", className: "primary" }, PAGE.start);
    this.counted = el("span", { className: "counted", role: "status" });
    this.checks = Object.entries(CHECKS).map(([bit, words]) => [Number(bit), el("input", { type: "checkbox" }), words]);
    this.list = el("fieldset", { className: "checks", ariaLabel: PAGE.before },
      ...this.checks.map(([, box, words]) => el("label", { className: "check" }, box, words)));
    this.missing = el("p", { className: "missing", role: "status" });
    this.pause = this.button(PAGE.pause, "therapy_session/pause");
    this.pause.append(el("small", {}, PAGE.pauses));
    this.resume = this.button(PAGE.resume, "therapy_session/resume");
    this.rest = this.button(PAGE.rest, "therapy_session/rest");
    this.rest.append(el("small", {}, PAGE.rests));
    this.end = this.button(PAGE.end, "therapy_session/abort");
    this.save = this.button(PAGE.save, "session_recorder/stop");
    this.told = el("p", { className: "told", role: "status" });
    const form = el("form", { onsubmit: (event) => this.submit(event) },
      el("div", { className: "row" },
        el("label", {}, PAGE.pseudonym, this.patient), el("label", {}, PAGE.armSide, this.side), this.new,
        this.again,
        el("label", { className: "wide" }, PAGE.movements, this.protocol)),
      this.game, el("div", { className: "row" }, this.plan.button, this.lastTime), this.plan.list, this.list,
      el("div", { className: "row" },
        el("label", { className: "check" }, this.record, PAGE.record),
        el("label", { className: "check" }, this.asks, PAGE.ask), this.start, this.counted), this.missing,
      this.proposed = el("p", { className: "proposed", role: "status" }),
      this.asked = el("p", { className: "asked", role: "status" }),
      this.left, this.acts = el("div", { className: "row" }, this.pause, this.resume, this.rest, this.end, this.save));
    form.noValidate = true;
    this.choose();
    this.element = el("section", { className: "card session" }, el("h2", {}, PAGE.session), form, this.told);
    this.show(null);
  }

  button(words, service) {
    return el("button", { type: "button", onclick: () => this.ask(service) }, words);
  }

  fresh() {
    this.patient.value = newPseudonym();
    this.tell(PAGE.write, true);
    this.count();
  }

  sameAgain() {
    this.patient.value = this.last;
    if (this.plan.next) this.propose(this.plan.next);
    this.again.hidden = true;
    this.count();
  }

  get chosen() {
    return this.protocols.find(({ name }) => name === this.protocol.value) ?? {};
  }

  // What stands in the form, for the plan.
  get item() {
    const { name, title, levels, minutes } = this.chosen;
    return levels ? { name, title, level: this.level.value, minutes: this.playTime } : { name, title, minutes };
  }

  propose({ name, level, minutes }) {
    this.protocol.value = name;
    this.choose();
    if (level) [this.level.value, this.minutes.value] = [level, minutes];
  }

  // What was last time counts for the protocol and the patient of last time.
  chooseAnother() {
    this.choose();
    this.forgetLastTime();
  }

  forgetLastTime() {
    this.isAsLast = false;
    this.sayLastTime();
  }

  sayLastTime() {
    const { about, isAsLast } = this;
    say(this.proposed, about ? asLastTime(about, isAsLast, this.known(about)?.title) : "");
    this.lastTime.hidden = !this.proposed.textContent || Boolean(this.isOn);
    this.lastTime.setAttribute("aria-pressed", isAsLast);
  }

  // Sets the form as it was last time; support, time and walls go with Start, so that nothing moves before.
  switchLastTime() {
    const { about } = this, known = this.known(about);
    this.isAsLast = !this.isAsLast;
    if (this.isAsLast) {
      if (about.side) this.side.value = about.side;
      if (known) this.propose({ name: known.name, level: about.level, minutes: about.trials });
    }
    this.sayLastTime();
  }

  // Shows the choices of a game; a protocol has none.
  choose() {
    const { levels = [], minutes, picture = "" } = this.chosen;
    this.game.hidden = !levels.length;
    this.level.replaceChildren(...levels.map((level) => el("option", { value: level }, said(level))));
    this.minutes.value = levels.length ? minutes : "";
    this.shown.hidden = !picture;
    if (picture) this.shown.src = `/games/${picture}`;
  }

  // Tells beside Start whether the pseudonym is known: a mistyped one would become a new patient.
  async count() {
    const patient = this.patient.value;
    say(this.counted, "");
    this.about = null;
    this.forgetLastTime();
    if (!WHOLE.test(patient)) return;
    this.plan.keepFor(patient);
    this.recall(patient);
    let words = PAGE.uncounted;
    try {
      const { success, sessions } = await this.call("session_recorder/count", { patient });
      if (success) words = sessionOf(sessions);
    } catch {
      // The recorder does not run: Start says so where it matters.
    }
    if (patient !== this.patient.value || this.isOn) return;
    say(this.counted, words);
  }

  // Proposes what was last time: the arm, if none is chosen; the rest in words, and by a button.
  async recall(patient) {
    const about = await this.recalled(patient).catch(() => null); // without a record nothing is proposed
    if (!about || patient !== this.patient.value || this.isOn) return;
    if (!this.side.value) this.side.value = about.side;
    this.about = about;
    this.sayLastTime();
  }

  async submit(event) {
    event.preventDefault();
    const [protocol, record] = [this.protocol.value, this.record.checked];
    const checks = this.checks.reduce((sum, [bit, box]) => sum + (box.checked ? bit : 0), this.asks.checked ? ASK : 0);
    const game = this.chosen.levels ? { level: this.level.value, minutes: this.playTime } : {};
    const asked = { ...this.whose(), protocol, record, checks, ...game };
    if (!this.isAsLast) {
      this.ask("therapy_session/start", asked);
      return;
    }
    const { support, duration, stiffness } = this.about;
    if (support !== null && !await this.carry(support)) return;
    this.ask("therapy_session/start", { ...asked, duration: duration ?? 0, side_stiffness: stiffness ?? 0 });
  }

  // Asks for a support of the arm [N]; returns whether it is given, and tells why not.
  async carry(support) {
    try {
      await setParameter(this.call, FORCE, Math.round(10 * support) / 10);
      return true;
    } catch (error) {
      this.tell(failure(error));
      return false;
    }
  }

  get space() {
    return this.chosen.space ?? "plane";
  }

  // Of a game [min].
  get playTime() {
    return Math.min(Math.max(Math.round(Number(this.minutes.value)), 1), MOST_MINUTES);
  }

  // The first thing that is missing for a session; unready: of the robot.
  lacking(unready) {
    const [, , words] = this.checks.find(([, box]) => !box.checked) ?? [];
    if (unready) return unready;
    if (!WHOLE.test(this.patient.value)) return PAGE.wanted;
    if (!this.side.value) return PAGE.sideWanted;
    return words ? toTick(words) : "";
  }

  // Whose arm it is.
  whose() {
    return { patient: this.patient.value, side: this.side.value };
  }

  async ask(service, args = {}) {
    this.tell("");
    try {
      const { success, message } = await this.call(service, args);
      this.tell(said(message), success);
    } catch (error) {
      this.tell(failure(error));
    }
  }

  tell(sentence, isGood = false) {
    say(this.told, sentence);
    this.told.classList.toggle("good", isGood);
  }

  // isStopped: the robot has stopped, so that a session would pause again at once; unready: why else none begins.
  show(state, isStopped = false, unready = PAGE.notReady) {
    const now = state?.state;
    const isOn = isUnderWay(state);
    if (isOn) this.take(state);
    else if (this.isOn) this.clear();
    this.isOn = isOn;
    for (const each of [this.patient, this.new, this.side, this.protocol, this.level, this.minutes, this.record, this.asks]) each.disabled = isOn;
    const missing = isOn ? "" : this.lacking(unready);
    say(this.missing, missing);
    this.list.hidden = this.start.hidden = this.plan.button.hidden = isOn;
    say(this.left, isOn ? leftWords(this.pace.left(state, this.known(state)), this.plan.after(this.chosen.name)) : "");
    this.acts.hidden = !isOn;
    this.start.disabled = Boolean(isOn || missing);
    const [asked, isAsked] = askedSentence(state);
    say(this.asked, asked);
    this.asked.classList.toggle("bad", isAsked);
    this.rest.disabled = now !== RUNNING;
    this.pause.disabled = now !== RUNNING && now !== STARTING && !isResting(state);
    const waits = now === STARTING && (state.asks || isAsked);
    this.resume.disabled = !(now === PAUSED || waits) || isStopped;
    this.end.disabled = !isOn;
    this.save.disabled = !(now && state.recorded);
  }

  known({ protocol }) {
    return this.protocols.find((each) => each.protocol === protocol);
  }

  // Shows whose session runs, also on a page that was opened, or connected again, in its midst.
  take({ patient, side, protocol, block, state, trials, recorded }) {
    this.patient.value = this.last = patient;
    if (!this.isOn) this.plan.keepFor(patient);
    this.side.value = side ?? "";
    say(this.counted, "");
    this.about = null;
    this.forgetLastTime();
    if (state !== STARTING) this.record.checked = recorded;
    this.again.hidden = true;
    const known = this.known({ protocol });
    if (!known) return;
    if (known.name !== this.protocol.value) {
      this.protocol.value = known.name;
      this.choose();
    }
    if (known.levels) [this.level.value, this.minutes.value] = [block, trials];
  }

  // After a session: the next patient's must not be kept under the pseudonym of the one before.
  clear() {
    this.patient.value = "P-";
    this.side.value = "";
    for (const [, box] of this.checks) box.checked = false;
    say(this.counted, "");
    this.record.checked = true;
    this.plan.end(this.chosen.name);
    this.again.textContent = again(this.last, this.plan.next);
    this.again.hidden = false;
  }
}
