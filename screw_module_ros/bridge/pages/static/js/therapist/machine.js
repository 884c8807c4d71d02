// SPDX-License-Identifier: Apache-2.0
// The robot as it stands now, seen from beside the patient: a check that what moves is what should.

import { el, fitted } from "../draw.js";
import { machineAt } from "../machine/kinematics.js";
import { camera, paint } from "../machine/picture.js";
import { PAGE } from "../words.js";

const EYE = [-2.2, -1.5, 1.15], AT = [0.1, 0.2, 0.19], TALL = 0.95; // [m]; tall: what is shown of it
const FLOOR = -0.25; // what stands lower says nothing [m]
const CUT = 0.12; // coarse: the picture is small [m]
const STILL = 3e-4; // a smaller change is not drawn again [m]

export class MachineCard {
  constructor() {
    this.canvas = el("canvas", { role: "img", ariaLabel: PAGE.machine });
    this.element = el("section", { className: "card machine" }, el("h2", {}, PAGE.machine), this.canvas);
    this.shown = [];
  }

  // Draws the machine with its handle where it is; an axis that is unknown stays where it was last.
  draw(endpoint) {
    const { clientWidth, clientHeight } = this.canvas;
    if (!endpoint || !clientHeight) return;
    const { x, y, z } = endpoint.position;
    const now = [x ?? this.shown[0] ?? 0, y ?? this.shown[1] ?? 0, z ?? this.shown[2] ?? 0, clientWidth, clientHeight];
    if (now.every((value, i) => Math.abs(value - this.shown[i]) < STILL)) return;
    this.shown = now;
    const { ctx, width, height } = fitted(this.canvas);
    const view = camera(EYE, AT, width, height, TALL * Math.max(1, (1.1 * height) / width));
    const solids = machineAt(...now.slice(0, 3)).filter(({ pose }) => pose.at[2] > FLOOR);
    paint(ctx, solids.map((solid) => ({ ...solid, cut: CUT })), view);
  }
}
