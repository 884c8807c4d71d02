// SPDX-License-Identifier: Apache-2.0
// The record of the patients, for a therapist. No pseudonym stands in the address of the page.

import { el, say } from "../draw.js";
import { language } from "../language.js";
import { configurationAtLast, ownToken } from "../link.js";
import { PAGE, RECORD, failure, forgotten } from "../words.js";
import { Desk } from "./desk.js";
import { PatientView, exportCard, forgetCard } from "./patient.js";
import { patientsCard } from "./patients.js";

const $ = (id) => document.getElementById(id);
let desk;

function notice(sentence) {
  $("notice").hidden = !sentence;
  say($("notice"), sentence);
}

// Does something of the record; tells what is wrong, and that it takes a while.
async function attempt(act) {
  notice(RECORD.wait);
  try {
    notice(await act() ?? "");
  } catch (error) {
    notice(failure(error));
  }
}

function show(title, ...elements) {
  say($("title"), title);
  $("shown").replaceChildren(...elements);
  window.onresize = null;
}

function back(words, go) {
  return el("div", { className: "row form" }, el("button", { type: "button", onclick: go }, words));
}

async function all() {
  show(RECORD.title, patientsCard(await desk.json("patients"), (patient) => goTo({ patient })));
}

function draw(patient, found) {
  const at = (part) => goTo({ patient, ...part });
  const view = new PatientView(found, {
    all: () => goTo({}), report: (session) => at({ session }), exports: () => at({ part: "export" }), forgets: () => at({ part: "forget" }),
    score: (scale, value, at = "") => attempt(async () => draw(patient, await desk.json(`${patient}/score`, { scale, value, at }))),
  });
  show(patient, ...view.elements);
  view.draw();
  window.onresize = () => view.draw();
}

async function report(patient, session) {
  const path = `${patient}/report?session=${session}`;
  const text = await (await desk.ask(path)).text();
  const [element, style] = text.match(/<style>([^]*?)<.style>/);
  const page = new DOMParser().parseFromString(text.replace(element, ""), "text/html");
  const place = el("div", { className: "report" });
  const sheet = new CSSStyleSheet(); // this page's policy allows no style within a page
  sheet.replaceSync(style);
  const shadow = place.attachShadow({ mode: "open" });
  shadow.adoptedStyleSheets = [sheet];
  shadow.append(...page.body.children);
  show(patient, el("div", { className: "row form" }, el("button", { type: "button", onclick: () => goTo({ patient }) }, RECORD.back),
    el("button", { type: "button", onclick: () => window.print() }, RECORD.print),
    el("button", { type: "button", onclick: () => attempt(() => desk.save(path)) }, RECORD.save)), place);
}

function exported(patient) {
  const words = (shift, rename) => [shift && "shift=1", rename && "rename=1"].filter(Boolean).join("&");
  show(patient, back(RECORD.back, () => goTo({ patient })), exportCard(
    (...asked) => attempt(() => desk.save(`${patient}/export?${words(...asked)}`))));
}

async function forget(patient) {
  const path = `${patient}/forget`;
  const done = (typed) => attempt(async () => {
    await desk.json(path, { pseudonym: typed });
    await goTo({}, "replaceState"); // the way back led to the patient
    return forgotten();
  });
  show(patient, back(RECORD.back, () => goTo({ patient })), forgetCard(patient, await desk.json(path), done));
}

// Shows a place of the record: {}, or with a patient, and of him a session's report, or a part.
function shown({ patient, session, part }) {
  return attempt(async () => {
    if (session) await report(patient, session);
    else if (part === "export") exported(patient);
    else if (part === "forget") await forget(patient);
    else if (patient) draw(patient, await desk.json(`${patient}/patient`));
    else await all();
  });
}

function goTo(place, how = "pushState") {
  history[how](place, "");
  return shown(place);
}

async function main() {
  document.documentElement.lang = language;
  document.title = RECORD.title;
  say($("title"), RECORD.title);
  const token = ownToken();
  const { role } = await configurationAtLast(token, (error) => notice(failure(error)));
  if (role !== "therapist") {
    notice(PAGE.wrongRole);
    return;
  }
  desk = new Desk(token);
  window.onpopstate = ({ state }) => shown(state ?? {});
  await shown(history.state ?? {});
}

main().catch(() => {}); // the sentence is on the page
