// SPDX-License-Identifier: Apache-2.0
// Results of the movements and changes of the assistance, newest first. The bridge sends those of the
// session so far with each subscription, so that a reload or another device shows them all.

import { measureTitle } from "../cells.js";
import { el, say } from "../draw.js";
import { isUnderWay } from "../link.js";
import { PAGE, assistanceSentence, changeSentence, playSentence, resultSentence } from "../words.js";

const SHOWN = 60, KEPT = 1100; // a session of the clock game has 1024 movements
const CHANGES = 8;
const DIGITS = { duration: 2, peak_speed: 0, path_error: 1, sparc: 2, robot_share: 0 };
const KEEP = ["patient", "kind", "assisted", "trial", "reached", "score", ...Object.keys(DIGITS)];

// A value in SI units as its column shows it.
function shown(value, { name, factor }) {
  const isKnown = typeof value === "number" && !Number.isNaN(value);
  return isKnown ? (factor * value).toFixed(DIGITS[name]) : "–";
}

function identity({ patient, protocol, trial, header }) {
  return JSON.stringify([patient, protocol, trial, header]);
}

// Circles, holding and pushing have no target to reach.
function isReach({ kind }) {
  return (kind ?? "reach") === "reach";
}

function reachedWord(result) {
  if (!isReach(result)) return "–";
  return result.reached ? PAGE.yes : PAGE.no;
}

export class MovementsCard {
  // measures: [{ name, label, unit, factor from SI }], of which the table shows those of DIGITS.
  constructor(measures) {
    this.measures = Object.keys(DIGITS).flatMap((name) => measures.filter((each) => each.name === name));
    this.begin("");
    this.summary = el("p", { className: "empty" });
    this.body = el("tbody");
    this.now = el("p", { className: "now" });
    this.list = el("ul", { className: "changes", tabIndex: 0, ariaLabel: PAGE.changes });
    const titles = ["#", PAGE.reached, ...this.measures.map(measureTitle)];
    this.table = el("div", { className: "scroll", tabIndex: 0, role: "region", ariaLabel: PAGE.results },
      el("table", {}, el("thead", {}, el("tr", {}, ...titles.map((title) => el("th", { scope: "col" }, title)))),
        this.body));
    this.element = el("section", { className: "card results" }, el("h2", {}, PAGE.results), this.summary,
      this.table,
      el("h2", {}, PAGE.assistance), this.now, this.list);
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

  // Shows the assistance in use; forgets the movements of the session before, as soon as another one is on.
  follow(state) {
    say(this.now, assistanceSentence(state));
    const { patient, protocol, trial } = state;
    const session = `${patient} ${protocol}`;
    const last = this.trials.at(-1);
    if (!last || !isUnderWay(state)) return;
    if (session === this.session && trial >= last.trial) return;
    this.begin(session);
  }

  // Takes a change of the assistance; the results that it follows from have come before it.
  takeChange({ block, circuit, duration, side_stiffness: side, reason }) {
    const last = this.changes.at(-1);
    if (last && (block < last.block || (block === last.block && circuit <= last.circuit))) return;
    this.changes.push({ block, circuit, duration, side, reason });
    if (this.changes.length > CHANGES) this.changes.shift();
    this.isShown = false;
  }

  show() {
    if (this.isShown) return;
    this.isShown = true;
    this.table.hidden = !this.trials.length;
    const reaches = this.trials.filter(isReach);
    const alone = reaches.filter((trial) => !trial.assisted);
    const played = this.trials.filter(({ kind }) => kind === "game");
    const patient = this.trials[0]?.patient;
    say(this.summary, played.length ? playSentence(patient, played)
      : patient ? resultSentence(patient, reaches, alone) : PAGE.noMovement);
    this.body.replaceChildren(...this.trials.slice(-SHOWN).reverse().map((result) => this.row(result)));
    const changes = this.changes.length ? this.changes.map(changeSentence).reverse() : [PAGE.noChange];
    this.list.replaceChildren(...changes.map((sentence) => el("li", {}, sentence)));
  }

  row(result) {
    const cells = [String(result.trial), reachedWord(result),
      ...this.measures.map((measure) => shown(result[measure.name], measure))];
    return el("tr", {}, ...cells.map((cell) => el("td", {}, cell)));
  }
}
