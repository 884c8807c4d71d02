// SPDX-License-Identifier: Apache-2.0
// What a patient does after another, and how long it takes. A plan belongs to one pseudonym and to this tab, where it
// outlives a page that is loaded again.

import { planned } from "../cells.js";
import { el, say } from "../draw.js";
import { RUNNING, isUnderWay } from "../link.js";
import { PAGE, remove } from "../words.js";

const ENOUGH = 3; // movements, from which on their own pace tells how long the others take
const KEPT = `plan ${globalThis.location?.search ?? ""}`; // of this robot
const LONGEST_S = 3; // between two states: a page that is silent for longer has paused the session

export class Plan {
  // chosen(): { name, title, level, minutes } of the form; propose(item): sets it there.
  constructor(chosen, propose) {
    const kept = globalThis.sessionStorage?.getItem?.(KEPT);
    [this.items, this.patient] = kept ? JSON.parse(kept) : [[], ""];
    this.button = el("button", { name: "plan", type: "button", onclick: () => {
      this.items.push(chosen());
      propose(this.items[0]);
      this.show();
    } }, PAGE.plan);
    this.list = el("ol", { className: "plan" });
    this.show();
  }

  get next() {
    return this.items[0];
  }

  // How long all takes that comes after a session of this name [min].
  after(name) {
    const rest = this.next?.name === name ? this.items.slice(1) : this.items;
    return rest.reduce((sum, { minutes }) => sum + minutes, 0);
  }

  // Keeps the plan for a pseudonym, and drops that of another one.
  keepFor(patient) {
    if (this.patient && this.patient !== patient) this.items = [];
    this.patient = patient;
    this.show();
  }

  // A session of a protocol has ended: what was planned next is done.
  end(name) {
    if (this.next?.name === name) this.items.shift();
    this.show();
  }

  show() {
    globalThis.sessionStorage?.setItem?.(KEPT, JSON.stringify([this.items, this.patient]));
    this.list.hidden = !this.items.length;
    this.list.replaceChildren(...this.items.map((item) => el("li", {}, planned(item),
      el("button", { type: "button", ariaLabel: remove(item), onclick: () => {
        this.items = this.items.filter((each) => each !== item);
        this.show();
      } }, "✕"))));
  }
}

export class Pace {
  constructor() {
    Object.assign(this, { key: "", first: 0, trial: 0, passed: 0, done: 0, now: 0 });
  }

  // Returns about how long a session still takes [min], null if that is not known. known: its protocol.
  left(state, known) {
    if (!isUnderWay(state) || !state.trials) return null;
    const { header: { stamp }, patient, protocol, trial, trials, since } = state;
    if (state.kind === "game") return trials - trial + 1 - (since ?? 0) / 60;
    const [now, key] = [stamp.sec + stamp.nanosec * 1e-9, `${patient} ${protocol}`];
    if (key !== this.key || trial < this.first) Object.assign(this, { key, first: trial, trial, passed: 0 });
    else if (state.state === RUNNING && now - this.now < LONGEST_S) this.passed += Math.max(now - this.now, 0);
    if (trial !== this.trial) [this.trial, this.done] = [trial, this.passed]; // of movements that are done
    this.now = now;
    const seen = trial - this.first;
    const each = seen >= ENOUGH ? this.done / seen : (60 * known?.minutes) / known?.trials;
    return Number.isFinite(each) ? ((trials - trial + 1) * each) / 60 : null;
  }
}
