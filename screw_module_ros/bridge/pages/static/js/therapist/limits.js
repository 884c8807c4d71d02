// SPDX-License-Identifier: Apache-2.0
// Limits of assistance and workspace: parameters of the session node, whose own bounds the sliders
// take from its descriptions.

import { el, say } from "../elements.js";

const NAMES = {
  "assistance.stiffness": "Stiffest wall of the next session", "wish.half_width": "Workspace, left and right",
  "wish.half_depth": "Workspace, near and far", "wish.low": "Workspace, lowest height",
  "wish.high": "Workspace, greatest height", "wish.speed": "Speed of what a game wishes",
};
const DOUBLE = 3; // ParameterType.msg

export class LimitsCard {
  constructor(call, changed = () => {}) {
    this.call = call;
    this.changed = changed;
    this.values = {};
    this.sliders = {};
    this.list = el("div", {}, el("p", { className: "empty" }, "Not known yet."));
    this.told = el("p", { className: "told", role: "status" });
    this.element = el("section", { className: "card limits" }, el("h2", {}, "Limits"), this.list, this.told);
  }

  // Asks the node for bounds and values, and shows them.
  async load() {
    const names = Object.keys(NAMES);
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
      say(this.told, error.message);
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
    const shown = el("output", {}, words(value, unit));
    const input = el("input", {
      type: "range", min: low, max: high, step: (high - low) / 100, ariaLabel: NAMES[name],
    });
    input.value = value;
    const slider = this.sliders[name] = {
      input,
      isHeld: false,
      show: (now) => {
        input.value = now;
        say(shown, words(now, unit));
      },
    };
    input.oninput = () => {
      slider.isHeld = true;
      say(shown, words(Number(input.value), unit));
    };
    input.onchange = () => {
      slider.isHeld = false;
      this.set(name, Number(input.value));
    };
    return el("label", { className: "limit" }, el("span", {}, NAMES[name]), input, shown);
  }

  async set(name, value) {
    const parameters = [{ name, value: { type: DOUBLE, double_value: value } }];
    try {
      const { results: [result] } = await this.call("therapy_session/set_parameters", { parameters });
      if (!result.successful) throw new Error(result.reason);
      this.values[name] = value;
      this.changed(this.values);
      this.told.classList.add("good");
      say(this.told, `${NAMES[name]}: set.`);
    } catch (error) {
      await this.load(); // first, as it says nothing where all is well
      this.told.classList.remove("good");
      say(this.told, error.message);
    }
  }
}

function words(value, unit) {
  return unit === "m" ? `${(100 * value).toFixed(1)} cm` : `${value.toFixed(value < 10 ? 2 : 0)} ${unit}`;
}
