// SPDX-License-Identifier: Apache-2.0
// A game that is a page of its own, in a frame. It has no token and reaches no robot: it gets the hand by
// messages, and what it answers goes the way of the built-in game. It gets no key and no touch either, so
// that any key stays the patient's stop.

import { el } from "../draw.js";

export class FramedGame {
  // page: a file that the bridge serves, or an address; title: of the game.
  constructor({ page, title }) {
    const isElsewhere = page.includes("/");
    this.element = el("iframe", { id: "game", title, inert: true, referrerPolicy: "no-referrer" });
    this.element.sandbox = isElsewhere ? "allow-scripts allow-same-origin" : "allow-scripts";
    this.element.src = isElsewhere ? page : `/games/${page}`;
    this.aim = this.told = null;
    this.take = this.take.bind(this);
    window.addEventListener("message", this.take);
    document.querySelector("main").prepend(this.element);
  }

  take({ source, data }) {
    if (source !== this.element.contentWindow) return;
    const { wish, score } = Object(data);
    if (Array.isArray(wish)) this.aim = [0, 1, 2].map((axis) => (Number.isFinite(wish[axis]) ? wish[axis] : null));
    if (score >= 0 && score <= 1) this.told = Number(score);
  }

  // moment: what a game is told, docs/games.md.
  tell(moment) {
    this.element.contentWindow?.postMessage(moment, "*");
  }

  // Returns the newest wish, once: a game that has ended wishes nothing.
  wish() {
    const { aim } = this;
    this.aim = null;
    return aim;
  }

  share() {
    const { told } = this;
    this.told = null;
    return told;
  }

  step() {}

  draw() {}

  close() {
    window.removeEventListener("message", this.take);
    this.element.remove();
  }
}
