// SPDX-License-Identifier: Apache-2.0
// Tones, made here, so nothing is loaded. A browser lets a page sound only after somebody has touched it.

const TONES = {
  pick: [660, 880], basket: [523, 659, 784, 1047], reached: [587, 784], // the patient's
  paused: [784, 659], stopped: [988, 740, 988, 740], // the therapist's
};

export class Sound {
  constructor(isOn = false) {
    this.isOn = isOn;
    this.context = null;
  }

  listen() {
    for (const touch of ["pointerdown", "keydown"]) document.addEventListener(touch, () => this.touched());
  }

  set(isOn) {
    this.isOn = isOn;
    this.touched();
  }

  touched() {
    if (!this.isOn) return;
    this.context ??= new AudioContext();
    this.context.resume();
  }

  play(name) {
    if (!this.isOn || this.context?.state !== "running") return;
    TONES[name].forEach((pitch, i) => this.tone(pitch, this.context.currentTime + 0.11 * i));
  }

  tone(pitch, at) {
    const [source, gain] = [this.context.createOscillator(), this.context.createGain()];
    source.frequency.value = pitch;
    source.type = "sine";
    gain.gain.setValueAtTime(0, at);
    gain.gain.linearRampToValueAtTime(0.15, at + 0.02);
    gain.gain.exponentialRampToValueAtTime(0.001, at + 0.25);
    source.connect(gain).connect(this.context.destination);
    source.start(at);
    source.stop(at + 0.3);
  }
}
