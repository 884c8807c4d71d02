// SPDX-License-Identifier: Apache-2.0
// Counts the targets that a screen has seen reached in a session. A screen that came late, or lost
// its connection, has not seen all and must not tell a number.

import { PAUSED, REACHED, RUNNING } from "../states.js";

export class Count {
  constructor() {
    this.begin(false);
  }

  begin(hasSeenAll) {
    this.trials = new Set(); // a trial that was paused after its target is done again
    this.hasSeenAll = hasSeenAll;
    this.hasOthers = false; // trials without a target: circles, holding, pushing
  }

  get reached() {
    return this.trials.size;
  }

  // Takes a message of therapy/state, with the one before or null; returns whether a target has
  // been reached just now. isOther: it is of another patient or protocol.
  take(state, before, isOther) {
    const wasOn = before?.state === RUNNING || before?.state === PAUSED;
    if (isOther) this.begin(state.trial === 1);
    else if (state.trial === 1 && state.state === RUNNING && !(wasOn && before.trial === 1)) this.begin(true);
    if (state.state === RUNNING && state.kind && state.kind !== "reach") this.hasOthers = true;
    const isSame = before?.phase === REACHED && before.trial === state.trial;
    const isReached = state.phase === REACHED && !isSame;
    if (isReached) this.trials.add(state.trial);
    return isReached;
  }

  miss() {
    this.hasSeenAll = false;
  }
}
