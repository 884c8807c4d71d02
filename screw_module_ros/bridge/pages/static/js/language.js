// SPDX-License-Identifier: Apache-2.0
// The language of the therapist's pages, chosen for this browser; the patient's screen has its own.

import { GERMAN } from "./german.js";
import { OF_NODES } from "./german_nodes.js";

const KEY = "therapists_language";
export const language = globalThis.localStorage?.getItem?.(KEY) === "de" ? "de" : "en";

// Changes to the other language; the page is loaded again, which takes less time than pauses a session.
export function changeLanguage() {
  localStorage.setItem(KEY, language === "de" ? "en" : "de");
  location.reload();
}

function filled(words, values) {
  return words.replace(/\{(\d)\}/g, (_, place) => values[place]);
}

// A sentence in that language, its {0}, {1} … filled in.
export function t(english, ...values) {
  return filled(language === "de" ? GERMAN[english] ?? english : english, values);
}

// All sentences of a table.
export function table(words) {
  if (typeof words === "string") return t(words);
  const found = Object.entries(words).map(([key, value]) => [key, table(value)]);
  return Array.isArray(words) ? found.map(([, value]) => value) : Object.fromEntries(found);
}

// What a node says ----------------------------------------------------------------------------

const FEW = 8; // letters of a pattern's own, like those of "{0} of {1}": it would fit any sentence

// Those with the most of their own first.
const PATTERNS = Object.entries(OF_NODES).filter(([english]) => english.includes("{0}")).map(([english, german]) => {
  const own = english.split(/\{\d\}/), letters = own.join("").replace(/[^a-z]/gi, "").length;
  const fits = new RegExp(`^${own.map((words) => words.replace(/[.*+?^$()|[\]\\]/g, "\\$&")).join("(.*?)")}$`, "s");
  return { fits, german, length: own.join("").length, letters };
}).sort((one, other) => other.length - one.length);
const [WITH_FEW, WITH_MORE] = [true, false].map((isFew) => PATTERNS.filter(({ letters }) => letters < FEW === isFew));

const MOST = 300; // sentences that are remembered: a page draws the same one again and again
const REMEMBERED = new Map();

// In the language of the page; what no pattern fits stays as the node says it.
export function said(english) {
  if (language === "en") return english;
  if (REMEMBERED.size > MOST) REMEMBERED.clear();
  if (!REMEMBERED.has(english)) REMEMBERED.set(english, english.split("; ").map(inGerman).join("; "));
  return REMEMBERED.get(english);
}

function inGerman(english) {
  if (Object.hasOwn(OF_NODES, english)) return OF_NODES[english];
  const [, blank, words] = /^(\s+)(.+)$/s.exec(english) ?? [];
  if (words) return blank + inGerman(words);
  const found = byPattern(english, false);
  if (found) return found;
  const parts = english.split(", ");
  if (parts.length > 1 && parts.every(isKnown)) return parts.map(inGerman).join(", ");
  const [, first, between, rest] = /^(.+?)(\. |: )(.+)$/s.exec(english) ?? [];
  return byPattern(english, true) ?? (rest ? inGerman(first) + between + inGerman(rest) : english);
}

// hasFew: the patterns with few letters, in whose places nothing unknown stands.
function byPattern(english, hasFew) {
  for (const { fits, german, letters } of hasFew ? WITH_FEW : WITH_MORE) {
    const [, ...values] = fits.exec(english) ?? [];
    if (values.length && (!hasFew || !letters || values.every(isKnown))) return filled(german, values.map(inGerman));
  }
  return undefined;
}

// Whether it has a pattern, or is a number with its unit.
function isKnown(words) {
  return /^\S*\d\S*( \S+)?$/.test(words) || inGerman(words) !== words;
}
