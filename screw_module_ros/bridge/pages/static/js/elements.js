// SPDX-License-Identifier: Apache-2.0
// Elements of a page, made by calls: el("button", { className: "stop" }, "Stop").

export function el(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key in made) made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

// Writes text into an element where it differs, so that screen readers hear only changes.
export function say(element, words) {
  if (element.textContent !== words) element.textContent = words;
}
