// SPDX-License-Identifier: Apache-2.0
// Results of the movements and changes of the assistance, newest first. The bridge sends those of the
// session so far with each subscription, so that a reload or another device shows them all.

import { el, say } from "../elements.js";
import { PAUSED, RUNNING } from "../states.js";

const SHOWN = 60, KEPT = 1100; // a session of the clock game has 1024 movements
const CHANGES = 8;
const COLUMNS = [
  ["#", (r) => r.trial],
  ["Reached", (r) => (!isReach(r) ? "–" : r.reached ? "✓ yes" : "– no")],
  ["Time [s]", (r) => fixed(r.duration, 2)],
  ["Peak [mm/s]", (r) => fixed(1000 * r.peak_speed, 0)],
  ["Path error [mm]", (r) => fixed(1000 * r.path_error, 1)],
  ["SPARC", (r) => fixed(r.sparc, 2)],
  ["Robot's share [%]", (r) => (r.robot_share === null ? "–" : fixed(100 * r.robot_share, 0))],
];
const KEEP = ["patient", "protocol", "header", "kind", "assisted", "trial", "block", "circuit", "reached", "duration", "peak_speed", "path_error", "sparc", "robot_share"];

function fixed(value, digits) {
  return value === null || Number.isNaN(value) ? "–" : value.toFixed(digits);
}

function identity({ patient, protocol, trial, header }) {
  return JSON.stringify([patient, protocol, trial, header]);
}

// Circles, holding and pushing have no target to reach.
function isReach({ kind }) {
  return (kind ?? "reach") === "reach";
}

function counted(reaches) {
  return `${reaches.filter(({ reached }) => reached).length} of ${reaches.length}`;
}

export class TrialsCard {
  constructor() {
    this.begin("");
    this.summary = el("p", { className: "empty" });
    this.body = el("tbody");
    this.list = el("ul", { className: "changes" });
    this.element = el("section", { className: "card results" }, el("h2", {}, "Movements"), this.summary,
      el("div", { className: "scroll" }, el("table", {},
        el("thead", {}, el("tr", {}, ...COLUMNS.map(([title]) => el("th", {}, title)))), this.body)),
      el("h2", {}, "Assistance"), this.list);
    this.show();
  }

  begin(session) {
    [this.session, this.trials, this.changes] = [session, [], []];
    this.known = new Set(); // each result comes again with each connection
    this.isShown = false;
  }

  take(result) {
    const session = `${result.patient} ${result.protocol}`;
    const last = this.trials.at(-1);
    if (this.known.has(identity(result))) return;
    if (session !== this.session || (last && result.trial <= last.trial)) this.begin(session);
    this.known.add(identity(result));
    this.trials.push(Object.fromEntries(KEEP.map((name) => [name, result[name]])));
    if (this.trials.length > KEPT) this.trials.shift();
    this.isShown = false;
  }

  // Forgets the movements of the session before, as soon as another one is on.
  follow({ state, patient, protocol, trial }) {
    const session = `${patient} ${protocol}`;
    const last = this.trials.at(-1);
    if (!last || (state !== RUNNING && state !== PAUSED)) return;
    if (session === this.session && trial >= last.trial) return;
    this.begin(session);
  }

  // Takes a change of the assistance; the results that it follows from have come before it.
  takeChange({ block, circuit, duration, side_stiffness: side, reason }) {
    const last = this.changes.at(-1);
    if (last && (block < last.block || (block === last.block && circuit <= last.circuit))) return;
    this.changes.push({ block, circuit, duration, side_stiffness: side, reason });
    if (this.changes.length > CHANGES) this.changes.shift();
    this.isShown = false;
  }

  show() {
    if (this.isShown) return;
    this.isShown = true;
    const reaches = this.trials.filter(isReach);
    const alone = reaches.filter((trial) => !trial.assisted);
    const apart = alone.length && alone.length < reaches.length
      ? `, without assistance ${counted(alone)}` : "";
    say(this.summary, this.trials.length
      ? `${this.session.split(" ")[0]}: ${counted(reaches)} targets reached${apart}`
      : "No movement yet.");
    this.body.replaceChildren(...this.trials.slice(-SHOWN).reverse().map((result) =>
      el("tr", {}, ...COLUMNS.map(([, cell]) => el("td", {}, String(cell(result)))))));
    this.list.replaceChildren(...(this.changes.length ? this.changes.slice().reverse().map((change) =>
      el("li", {}, `Block ${change.block}, circuit ${change.circuit}: ${change.duration.toFixed(2)} s, side walls `
        + `${change.side_stiffness.toFixed(0)} N/m; ${change.reason}`)) : [el("li", {}, "No change yet.")]));
  }
}
