// SPDX-License-Identifier: Apache-2.0
// What cells of tables, choices, titles and plots of the therapist's pages are made of; their sentences are
// in `words.js`. Labels and units of measures come from the bridge (`config.measures`), titles of protocols too.

import { said, t, table } from "./language.js";

// Quantities ----------------------------------------------------------------------------------

export function newtons(force) {
  return `${force.toFixed(1)} N`;
}

// How much is carried, also as a share of the weight.
export function supportShare(force, weight) {
  return weight ? `${newtons(force)}, ${Math.round((100 * force) / weight)} %` : newtons(force);
}

export function minutesWords(minutes) {
  return `${Math.max(1, Math.round(minutes))} min`;
}

// What is planned, and about how long it takes.
export function planned({ title, level, minutes }) {
  return `${[title, level].filter(Boolean).map(said).join(", ")}: ${minutesWords(minutes)}`;
}

export function quantity(value, unit) {
  return unit === "m" ? `${(100 * value).toFixed(1)} cm` : `${value.toFixed(value < 10 ? 2 : 0)} ${unit}`;
}

// Title of a measure's column, as `Peak speed [mm/s]`.
export function measureTitle({ label, unit }) {
  const word = said(label);
  const words = word[0].toUpperCase() + word.slice(1);
  return unit ? `${words} [${unit}]` : words;
}

// Choices -------------------------------------------------------------------------------------

export const SIDES = table({ "": "which?", left: "left", right: "right" });

export function sideWords(side) {
  return SIDES[side] ?? side;
}

export const SCALES = table({
  pain_before: "Pain before", pain_after: "Pain after", tired_before: "Tiredness before", tired_after: "Tiredness after",
  pain_pause: "Pain at a pause", tired_pause: "Tiredness at a pause", went_on: "Went on after much of it",
  discomfort: "Discomfort", FM_UE: "Fugl-Meyer, upper extremity", ARAT: "ARAT", MAS_elbow: "Ashworth, elbow", MAS_shoulder: "Ashworth, shoulder",
  rests: "Rests", spasms: "Spasms", chair_x: "Chair, to the side [cm]", chair_height: "Chair, height [cm]", handle_angle: "Handle [°]",
  side: "Arm to be trained", closed: "Therapy",
});

// Values that may be chosen; another scale up to 10 has whole numbers, a longer one is typed.
const ASHWORTH = [0, 1, 1.5, 2, 3, 4];
export const CHOICES = { MAS_elbow: ASHWORTH, MAS_shoulder: ASHWORTH };

export function choiceWords(scale, value) {
  if (scale === "side") return sideWords(value ? "right" : "left");
  if (scale === "closed") return value ? t("closed") : t("open");
  if (scale === "went_on") return value ? t("yes") : t("no");
  return CHOICES[scale] && value === 1.5 ? "1+" : String(value);
}

// Tables and plots of the record --------------------------------------------------------------

// A local time with its zone, of ISO 8601.
export function moment(at) {
  const [day, time = ""] = at.split("T");
  return [day, time.slice(0, 5), time.match(/[+-].*$/)?.[0]].filter(Boolean).join(" ");
}

const DUE = { weigh: t("weigh the arm"), assess: t("Fugl-Meyer or ARAT") };

export function dueWords({ due }) {
  return due.map((each) => DUE[each]).join(", ");
}

// What the last session ended with: support, time and side walls.
export function proposal({ support, duration, stiffness }) {
  return [support != null && t("{0} N support", support.toFixed(1)), duration != null && t("{0} s a movement", duration.toFixed(2)),
    stiffness != null && t("{0} N/m side walls", stiffness.toFixed(0))].filter(Boolean).join(", ");
}

export function sessionCells({ begun, protocol, level, side, trials, outcome, stops, support, simulated }) {
  const why = Object.entries(stops).map(([reason, count]) => (count > 1 ? `${said(reason)} (${count})` : said(reason)));
  return [moment(begun), [protocol, level && `, ${said(level)}`, simulated && ` (${t("simulated")})`].filter(Boolean).join(""), sideWords(side), String(trials),
    [said(outcome), ...why].filter(Boolean).join("; "), support === null ? "" : newtons(support)];
}

export function weekWords(weeks) {
  return t("{0} weeks", weeks.toFixed(weeks < 10 ? 1 : 0));
}

// What stands below a plot; what it says to who cannot see it.
export function firstAndLatest({ points }) {
  return (points.length > 1 ? [points[0], points.at(-1)] : points).map(({ text }) => said(text)).join(" → ");
}

export function plotted(line) {
  return `${said(line.label)}: ${firstAndLatest(line)}`;
}
