// SPDX-License-Identifier: Apache-2.0
// Soft tones, off until somebody switches them on; made here, so nothing is loaded.

const TONES = { pick: [660, 880], basket: [523, 659, 784, 1047], reached: [587, 784] };

export class Sound {
  constructor() {
    this.isOn = false;
    this.context = null;
  }

  toggle() {
    this.isOn = !this.isOn;
    if (this.isOn) this.context ??= new AudioContext();
    return this.isOn;
  }

  play(name) {
    if (!this.isOn) return;
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
