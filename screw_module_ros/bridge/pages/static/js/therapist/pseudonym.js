// SPDX-License-Identifier: Apache-2.0
// Pseudonyms, as therapy/pseudonym.py makes them: P- and five signs that look like no other,
// with a digit: else a name of five letters would be one.

const ALPHABET = "23456789ABCDEFGHJKMNPQRSTVWXYZ";
export const PATTERN = `P-(?=.*[2-9])[${ALPHABET}]{5}`;

export function newPseudonym() {
  const signs = [];
  while (signs.length < 5 || !signs.some((sign) => "2" <= sign && sign <= "9")) {
    if (signs.length === 5) signs.length = 0;
    const [byte] = crypto.getRandomValues(new Uint8Array(1));
    if (byte < ALPHABET.length * Math.floor(256 / ALPHABET.length)) {
      signs.push(ALPHABET[byte % ALPHABET.length]);
    }
  }
  return `P-${signs.join("")}`;
}

// What of a typed text may stand in the field: names and other free text do not get in.
export function cleaned(text) {
  const kept = text.toUpperCase().replace(/^P-?/, "");
  return `P-${[...kept].filter((sign) => ALPHABET.includes(sign)).slice(0, 5).join("")}`;
}
