// SPDX-License-Identifier: Apache-2.0
// The screen stays on while its page is seen: nobody touches it during a session, and a tablet would dim.

export class Awake {
  // told(isHeld): called with what came of it, each time that the browser was asked.
  constructor(told = () => {}) {
    this.told = told;
    this.isAsking = false;
    this.lock = null;
    // A browser takes the lock back whenever the page is hidden.
    document.addEventListener("visibilitychange", () => this.ask());
  }

  // Asks for the lock unless it is held. A browser without one, or that refuses it with a low battery,
  // goes on as it is.
  async ask() {
    const isHeld = this.lock && !this.lock.released;
    if (isHeld || this.isAsking || document.visibilityState !== "visible") return;
    this.isAsking = true;
    try {
      this.lock = await navigator.wakeLock?.request("screen") ?? null;
    } catch {
      this.lock = null;
    }
    this.isAsking = false;
    this.told(this.lock !== null);
  }
}

// Makes the button that enters and leaves full screen.
export function makeFullScreen(button) {
  button.onclick = () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen?.().catch(() => {});
  };
}
