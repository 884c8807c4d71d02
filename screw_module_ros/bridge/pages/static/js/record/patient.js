// SPDX-License-Identifier: Apache-2.0
// One patient: eleven lines over weeks, sessions, scores; report, export and forget.

import { CHOICES, SCALES, choiceWords, moment, sessionCells, sideWords } from "../cells.js";
import { el } from "../draw.js";
import { said } from "../language.js";
import { RECORD, countWords, forgetTitle } from "../words.js";
import { table } from "./patients.js";
import { LineCard } from "./plot.js";

// acts: what the buttons do: all(), report(session), exports(), forgets(), score(scale, value, at).
export class PatientView {
  constructor(found, acts) {
    this.acts = acts;
    const { about, progress, sessions, scores, scales } = found;
    const button = (words, onclick, className = "") => el("button", { type: "button", onclick, className }, words);
    const side = el("select", { ariaLabel: RECORD.side }, ...["", "left", "right"].map(
      (value) => el("option", { value, selected: value === (about?.side ?? "") }, sideWords(value))));
    side.onchange = () => side.value && acts.score("side", side.value === "right" ? 1 : 0);
    const closed = Boolean(about?.closed);
    const head = el("section", { className: "card row" }, button(RECORD.all, acts.all),
      el("label", {}, RECORD.side, side),
      button(closed ? RECORD.reopen : RECORD.close, () => acts.score("closed", closed ? 0 : 1)),
      button(RECORD.print, () => window.print()),
      button(RECORD.exports, () => acts.exports()), button(RECORD.forget, () => acts.forgets(), "bad"),
      el("span", { className: "about" }, countWords(about)));
    this.lines = (progress?.lines ?? []).map((line) => new LineCard(line, progress.weeks));
    const lines = el("section", { className: "lines" }, ...this.lines.map(({ element }) => element),
      el("p", { className: "line note" }, progress ? `${said(progress.note)} ${RECORD.statement}` : RECORD.noProgress));
    const held = sessions.map((each, n) => el("tr", {},
      el("td", { className: "count" }, String(n + 1)), ...sessionCells(each).map((words, n) => el("td", { className: n ? "" : "when" }, words)),
      el("td", {}, button(RECORD.report, () => acts.report(n + 1))))).reverse();
    const told = scores.map(({ at, scale, value }) => el("tr", {},
      el("td", { className: "when" }, moment(at)), el("td", {}, SCALES[scale] ?? scale), el("td", {}, choiceWords(scale, value)))).reverse();
    this.elements = [head, lines, el("div", { className: "pair" },
      el("section", { className: "card" }, el("h2", {}, RECORD.sessions), table(RECORD.sessionColumns, held)),
      el("section", { className: "card" }, el("h2", {}, RECORD.scores), this.form(scales, sessions), table(RECORD.scoreColumns, told)))];
  }

  form(scales, sessions) {
    const names = Object.keys(scales).filter((name) => !["side", "closed"].includes(name));
    const scale = el("select", { ariaLabel: RECORD.scale }, ...names.map((name) => el("option", { value: name }, SCALES[name] ?? name)));
    const place = el("span");
    let value;
    scale.onchange = () => {
      const choices = CHOICES[scale.value] ?? (scales[scale.value] <= 10 ? [...Array(scales[scale.value] + 1).keys()] : null);
      value = choices
        ? el("select", { ariaLabel: RECORD.value }, ...choices.map((each) => el("option", { value: each }, choiceWords(scale.value, each))))
        : el("input", { className: "value", type: "number", min: 0, max: scales[scale.value], step: "any", required: true, ariaLabel: RECORD.value });
      place.replaceChildren(value);
    };
    scale.onchange();
    const when = el("select", { ariaLabel: RECORD.when }, el("option", { value: "" }, RECORD.now),
      ...sessions.filter(({ begun }) => begun).reverse().map(({ begun }) => el("option", { value: begun }, moment(begun))));
    const keep = (event) => {
      event.preventDefault();
      this.acts.score(scale.value, Number(value.value), when.value);
    };
    return el("form", { className: "row form", onsubmit: keep }, scale, place, when, el("button", { type: "submit" }, RECORD.keep));
  }

  draw() {
    for (const each of this.lines) each.draw();
  }
}

// What is exported, and how; save(shift, rename).
export function exportCard(save) {
  const [shift, rename] = [el("input", { type: "checkbox" }), el("input", { type: "checkbox" })];
  return el("section", { className: "card" }, el("h2", {}, RECORD.exports), el("p", {}, RECORD.exportSays),
    el("div", { className: "row" }, el("label", {}, shift, RECORD.shift), el("label", {}, rename, RECORD.rename),
      el("button", { type: "button", onclick: () => save(shift.checked, rename.checked) }, RECORD.download)));
}

// Lists what goes and what stays, and asks for the pseudonym again; forget(typed).
export function forgetCard(name, { own, shared, beyond }, forget) {
  const list = (words) => el("ul", { className: "kept" }, ...words.map((each) => el("li", {}, each)));
  const typed = el("input", { className: "pseudonym", maxLength: 7, autocomplete: "off", spellcheck: false, ariaLabel: RECORD.again });
  const go = el("button", { type: "submit", className: "bad", disabled: true }, RECORD.forget);
  typed.oninput = () => { go.disabled = typed.value !== name; };
  const submit = (event) => {
    event.preventDefault();
    forget(typed.value);
  };
  return el("section", { className: "card" }, el("h2", {}, forgetTitle(name)), el("p", {}, RECORD.deleted), list([...own, RECORD.rows]),
    el("p", {}, RECORD.unreached), list([...shared, ...beyond.map(said)]),
    el("form", { className: "row", onsubmit: submit }, el("label", {}, RECORD.again, typed), go));
}
