// SPDX-License-Identifier: Apache-2.0
// Full screen, in which the screen stays on: a patient does not touch it, and a tablet would dim in the
// middle of a session.

export class Awake {
  constructor() {
    this.isWanted = this.isAsking = false;
    this.lock = null;
    // A browser takes the lock back whenever the page is hidden.
    document.addEventListener("visibilitychange", () => this.ask());
  }

  want(isWanted) {
    this.isWanted = isWanted;
    if (!isWanted) this.release();
    return this.ask();
  }

  // Asks for the lock if it is wanted and not held. A browser without one, or that refuses it with a low
  // battery, goes on as it is.
  async ask() {
    const isHeld = this.lock && !this.lock.released;
    if (!this.isWanted || isHeld || this.isAsking || document.visibilityState !== "visible") return;
    this.isAsking = true;
    try {
      this.lock = await navigator.wakeLock?.request("screen") ?? null;
    } catch {
      this.lock = null;
    }
    this.isAsking = false;
    if (!this.isWanted) this.release(); // meanwhile
  }

  release() {
    this.lock?.release().catch(() => {});
    this.lock = null;
  }
}

// Makes the button that enters and leaves full screen.
export function makeFullScreen(button) {
  const awake = new Awake();
  button.onclick = () => {
    if (document.fullscreenElement) {
      document.exitFullscreen();
      return;
    }
    document.documentElement.requestFullscreen?.().catch(() => {});
    awake.want(true); // also where there is no full screen
  };
  document.addEventListener("fullscreenchange", () => awake.want(Boolean(document.fullscreenElement)));
}
