// SPDX-License-Identifier: Apache-2.0
// The list of all patients: who is in therapy, what is due, what is proposed for the next session.

import { dueWords, moment, proposal, sideWords } from "../cells.js";
import { el } from "../draw.js";
import { said } from "../language.js";
import { PATTERN, cleaned } from "../therapist/session.js";
import { RECORD } from "../words.js";

export function table(heads, rows) {
  return el("div", { className: "scroll" }, el("table", {},
    el("thead", {}, el("tr", {}, ...heads.map((words) => el("th", { scope: "col" }, words)))),
    el("tbody", {}, ...rows)));
}

// patients: of the bridge; open(patient): shows one of them.
export function patientsCard({ patients, notes }, open) {
  const rows = (withClosed) => patients.filter(({ closed }) => withClosed || !closed).map((each) => el("tr",
    { className: each.closed ? "closed" : "" },
    el("td", {}, el("button", { type: "button", onclick: () => open(each.patient) }, each.patient)),
    ...[sideWords(each.side), moment(each.seen)].map((words) => el("td", {}, words)),
    el("td", { className: "count" }, String(each.sessions)),
    ...[dueWords(each), proposal(each)].map((words) => el("td", {}, words))));
  const place = el("div");
  const box = el("input", { type: "checkbox", onchange: () => show() });
  const show = () => place.replaceChildren(patients.length
    ? table(RECORD.columns, rows(box.checked)) : el("p", { className: "note" }, RECORD.none));
  show();
  const name = el("input", { className: "pseudonym", pattern: PATTERN, value: "P-", maxLength: 7, required: true,
    autocomplete: "off", spellcheck: false, ariaLabel: RECORD.other });
  name.oninput = () => { name.value = cleaned(name.value); };
  const find = (event) => {
    event.preventDefault();
    open(name.value);
  };
  return el("section", { className: "card patients" },
    el("form", { className: "row form", onsubmit: find },
      el("label", {}, RECORD.other, name), el("button", { type: "submit" }, RECORD.open),
      el("label", {}, box, RECORD.withClosed)),
    place, ...notes.map((words) => el("p", { className: "note" }, said(words))));
}
