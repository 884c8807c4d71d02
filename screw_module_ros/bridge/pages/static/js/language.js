// SPDX-License-Identifier: Apache-2.0
// The language of the therapist's pages, chosen for this browser; the patient's screen has its own.

import { GERMAN, OF_NODES } from "./german.js";

const KEY = "therapists_language";
export const language = globalThis.localStorage?.getItem?.(KEY) === "de" ? "de" : "en";

// Changes to the other language; the page is loaded again, which takes less time than pauses a session.
export function changeLanguage() {
  localStorage.setItem(KEY, language === "de" ? "en" : "de");
  location.reload();
}

// A sentence in that language, its {0}, {1} … filled in.
export function t(english, ...values) {
  const found = language === "de" ? GERMAN[english] ?? english : english;
  return found.replace(/\{(\d)\}/g, (_, place) => values[place]);
}

// All sentences of a table.
export function table(words) {
  if (typeof words === "string") return t(words);
  const found = Object.entries(words).map(([key, value]) => [key, table(value)]);
  return Array.isArray(words) ? found.map(([, value]) => value) : Object.fromEntries(found);
}

// What a node says.
export function said(english) {
  return language === "de" ? OF_NODES[english] ?? english : english;
}
