// SPDX-License-Identifier: Apache-2.0
// Limits of assistance and workspace: parameters of the session node, whose own bounds the sliders
// take from its descriptions.

import { quantity } from "../cells.js";
import { el, say } from "../draw.js";
import { LIMITS, PAGE, failure, patientSound, wasSet } from "../words.js";
import { setParameter } from "./parameters.js";

export class LimitsCard {
  constructor(call, changed = () => {}) {
    this.call = call;
    this.changed = changed;
    this.values = {};
    this.sliders = {};
    this.list = el("div", {}, el("p", { className: "empty" }, PAGE.unknown));
    this.told = el("p", { className: "told", role: "status" });
    this.element = el("section", { className: "card limits" }, el("h2", {}, PAGE.limits), this.list, this.told,
      this.sound = el("button", { type: "button", onclick: () => this.switchSound() }));
    this.show(null);
  }

  // Shows whether the patient's screen sounds, as the session's state tells it.
  show(state) {
    this.hasSound = Boolean(state?.sound);
    this.sound.disabled = !state;
    say(this.sound, patientSound(this.hasSound));
  }

  async switchSound() {
    try {
      await setParameter(this.call, "patient_sound", !this.hasSound);
      say(this.told, "");
    } catch (error) {
      say(this.told, failure(error));
    }
  }

  // Asks the node for bounds and values, and shows them.
  async load() {
    const names = Object.keys(LIMITS);
    try {
      const described = await this.call("therapy_session/describe_parameters", { names });
      const { values } = await this.call("therapy_session/get_parameters", { names });
      this.list.replaceChildren(...described.descriptors.map((descriptor, i) => {
        this.values[names[i]] = values[i].double_value;
        return this.slider(names[i], descriptor, values[i].double_value);
      }));
      this.changed(this.values);
      say(this.told, "");
    } catch (error) {
      say(this.told, failure(error));
    }
  }

  // Asks the node for the values: another therapist's page may have set them.
  async refresh() {
    const names = Object.keys(this.sliders);
    if (!names.length) return;
    const asked = names.map((name) => this.values[name]);
    let values;
    try {
      ({ values } = await this.call("therapy_session/get_parameters", { names }));
    } catch {
      return; // the page shows elsewhere that the node is silent
    }
    names.forEach((name, i) => {
      const value = values[i]?.double_value;
      const { isHeld } = this.sliders[name];
      const isNews = value !== undefined && value !== this.values[name];
      if (!isNews || isHeld || this.values[name] !== asked[i]) return;
      this.values[name] = value;
      this.sliders[name].show(value);
    });
    this.changed(this.values);
  }

  slider(name, descriptor, value) {
    const [{ from_value: low, to_value: high }] = descriptor.floating_point_range;
    const unit = /\[(.+?)\]/.exec(descriptor.description)?.[1] ?? "";
    const shown = el("output", {}, quantity(value, unit));
    const input = el("input", {
      type: "range", min: low, max: high, step: (high - low) / 100, ariaLabel: LIMITS[name],
    });
    input.value = value;
    const slider = this.sliders[name] = {
      input,
      isHeld: false,
      show: (now) => {
        input.value = now;
        say(shown, quantity(now, unit));
      },
    };
    input.oninput = () => {
      slider.isHeld = true;
      say(shown, quantity(Number(input.value), unit));
    };
    input.onchange = () => {
      slider.isHeld = false;
      this.set(name, Number(input.value));
    };
    return el("label", { className: "limit" }, el("span", {}, LIMITS[name]), input, shown);
  }

  async set(name, value) {
    try {
      await setParameter(this.call, name, value);
      this.values[name] = value;
      this.changed(this.values);
      this.told.classList.add("good");
      say(this.told, wasSet(name));
    } catch (error) {
      await this.load(); // first, as it says nothing where all is well
      this.told.classList.remove("good");
      say(this.told, failure(error));
    }
  }
}
