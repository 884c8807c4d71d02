// SPDX-License-Identifier: Apache-2.0
// Results of the movements and changes of the assistance, newest first. The bridge keeps them, so
// that a reload or another device in mid-session shows them all; here nothing is stored.

import { el, say } from "../elements.js";

const SHOWN = 60, KEPT = 1100; // a session of the clock game has 1024 movements
const CHANGES = 8;
const COLUMNS = [
  ["#", (r) => r.trial],
  ["Reached", (r) => (r.reached ? "✓ yes" : "– no")],
  ["Time [s]", (r) => fixed(r.duration, 2)],
  ["Peak [cm/s]", (r) => fixed(100 * r.peak_speed, 1)],
  ["Path error [mm]", (r) => fixed(1000 * r.path_error, 1)],
  ["SPARC", (r) => fixed(r.sparc, 2)],
  ["Robot's share [%]", (r) => (r.robot_share === null ? "–" : fixed(100 * r.robot_share, 0))],
];
const KEEP = ["trial", "block", "circuit", "reached", "duration", "peak_speed", "path_error", "sparc", "robot_share"];

function fixed(value, digits) {
  return value === null || Number.isNaN(value) ? "–" : value.toFixed(digits);
}

export class TrialsCard {
  constructor() {
    [this.session, this.trials, this.changes] = ["", [], []];
    this.summary = el("p", { className: "empty" });
    this.body = el("tbody");
    this.list = el("ul", { className: "changes" });
    this.element = el("section", { className: "card results" }, el("h2", {}, "Movements"), this.summary,
      el("div", { className: "scroll" }, el("table", {},
        el("thead", {}, el("tr", {}, ...COLUMNS.map(([title]) => el("th", {}, title)))), this.body)),
      el("h2", {}, "Assistance"), this.list);
    this.show();
  }

  take(result) {
    const session = `${result.patient} ${result.protocol}`;
    const last = this.trials.at(-1);
    if (last && session === this.session && result.trial === last.trial) return; // told before
    if (session !== this.session || (last && result.trial < last.trial)) {
      [this.session, this.trials, this.changes] = [session, [], []];
    }
    this.trials.push(Object.fromEntries(KEEP.map((name) => [name, result[name]])));
    if (this.trials.length > KEPT) this.trials.shift();
    this.isShown = false;
  }

  takeChange({ block, circuit, duration, side_stiffness: side, reason }) {
    const last = this.changes.at(-1);
    if (last?.block === block && last?.circuit === circuit) return;
    this.changes.push({ block, circuit, duration, side, reason });
    if (this.changes.length > CHANGES) this.changes.shift();
    this.isShown = false;
  }

  // Begins anew with what the bridge has kept.
  begin(trials, changes) {
    [this.session, this.trials, this.changes] = ["", [], []];
    trials.forEach((trial) => this.take(trial));
    changes.forEach((change) => this.takeChange(change));
    this.isShown = false;
  }

  show() {
    if (this.isShown) return;
    this.isShown = true;
    const reached = this.trials.filter((trial) => trial.reached).length;
    say(this.summary, this.trials.length
      ? `${this.session.split(" ")[0]}: ${reached} of ${this.trials.length} targets reached`
      : "No movement yet.");
    this.body.replaceChildren(...this.trials.slice(-SHOWN).reverse().map((result) =>
      el("tr", {}, ...COLUMNS.map(([, cell]) => el("td", {}, String(cell(result)))))));
    this.list.replaceChildren(...(this.changes.length ? this.changes.slice().reverse().map((change) =>
      el("li", {}, `Block ${change.block}, circuit ${change.circuit}: ${change.duration.toFixed(2)} s, side walls `
        + `${change.side.toFixed(0)} N/m. ${change.reason}`)) : [el("li", {}, "No change yet.")]));
  }
}
