// SPDX-License-Identifier: Apache-2.0
// The therapist's page: one panel per robot.

import { Bridge, configurationAtLast } from "../bridge.js";
import { say } from "../elements.js";
import { ownToken } from "../token.js";
import { RobotPanel } from "./robot.js";

const ATTEND_MS = 500; // a session pauses after 2 s without
const $ = (id) => document.getElementById(id);
let panels = [];

function notice(sentence) {
  $("notice").hidden = !sentence;
  say($("notice"), sentence);
}

function connected(isOpen, sentence) {
  document.body.dataset.open = isOpen;
  say($("connection"), isOpen ? "Connected" : "No connection: a session that runs pauses by itself");
  notice(sentence || (isOpen ? "" : "The connection is lost. This page connects again by itself."));
  if (isOpen) for (const panel of panels) panel.limits.load();
}

function frame(now) {
  for (const panel of panels) panel.draw(now);
  requestAnimationFrame(frame);
}

async function main() {
  const token = ownToken();
  const config = await configurationAtLast(token, notice);
  if (config.role !== "therapist") {
    notice("This token is the patient's: open the therapist's address.");
    return;
  }
  notice("");
  const bridge = new Bridge(token, connected);
  panels = config.robots.map((robot) => new RobotPanel(robot, config, bridge));
  $("robots").classList.toggle("several", panels.length > 1);
  $("robots").append(...panels.map((panel) => panel.element));
  bridge.connect();
  setInterval(() => panels.forEach((panel) => panel.attend()), ATTEND_MS);
  requestAnimationFrame(frame);
}

main().catch(() => {}); // the sentence is on the page
