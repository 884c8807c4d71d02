// SPDX-License-Identifier: Apache-2.0
// Drawing for both pages: elements, a sharp canvas, colours, shapes, and hand and goals as every scene
// shows them. Sizes on a canvas are in CSS pixels.

import { MOVING, OVER_TIME, PREPARE, REACHED } from "./link.js";

// Colours of Okabe and Ito (2008). No meaning hangs on a colour alone: shapes differ too.
export const ORANGE = "#e69f00";
export const SKY = "#56b4e9";
export const GREEN = "#009e73";
export const YELLOW = "#f0e442";
export const BLUE = "#0072b2";
export const VERMILLION = "#d55e00";
export const PURPLE = "#cc79a7";
export const INK = "#16212b";
export const SOFT = "#6b7883";
export const LINE = "#d5d9dc";
export const PAPER = "#f7f5ef";

const MOST_PIXELS = 4.2e6; // beyond it a picture costs more time than sharpness is worth

// Elements of a page, made by calls: el("button", { className: "stop" }, "Stop").
export function el(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key in made) made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

// Writes text into an element where it differs, so that screen readers hear only changes.
export function say(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

// Fits the canvas to its place; returns { ctx, width, height } in CSS pixels, cleared.
export function fitted(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const most = Math.sqrt(MOST_PIXELS / Math.max(width * height, 1));
  const ratio = Math.min(window.devicePixelRatio || 1, Math.max(most, 0.5));
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const ctx = canvas.getContext("2d", { alpha: true });
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  ctx.clearRect(0, 0, width, height);
  return { ctx, width, height };
}

export function disc(ctx, x, y, radius, fill, edge = null, width = 3) {
  ctx.beginPath();
  ctx.arc(x, y, Math.max(radius, 0), 0, 2 * Math.PI);
  paint(ctx, fill, edge, width);
}

export function diamond(ctx, x, y, radius, fill, edge = null, width = 3) {
  ctx.beginPath();
  ctx.moveTo(x, y - radius);
  ctx.lineTo(x + radius, y);
  ctx.lineTo(x, y + radius);
  ctx.lineTo(x - radius, y);
  ctx.closePath();
  paint(ctx, fill, edge, width);
}

export function tick(ctx, x, y, radius, colour) {
  ctx.beginPath();
  ctx.moveTo(x - 0.45 * radius, y + 0.02 * radius);
  ctx.lineTo(x - 0.1 * radius, y + 0.38 * radius);
  ctx.lineTo(x + 0.5 * radius, y - 0.35 * radius);
  ctx.lineCap = "round";
  ctx.lineJoin = "round";
  paint(ctx, null, colour, 0.22 * radius);
}

export function line(ctx, x1, y1, x2, y2, colour, width, dash = []) {
  ctx.beginPath();
  ctx.setLineDash(dash);
  ctx.lineCap = dash.length ? "butt" : "round";
  ctx.moveTo(x1, y1);
  ctx.lineTo(x2, y2);
  paint(ctx, null, colour, width);
  ctx.setLineDash([]);
}

export function arc(ctx, x, y, radius, share, colour, width) {
  ctx.beginPath();
  ctx.arc(x, y, radius, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * Math.min(Math.max(share, 0), 1));
  paint(ctx, null, colour, width);
}

export function arrow(ctx, x, y, dx, dy, colour, width) {
  const length = Math.hypot(dx, dy);
  if (length < 1e-9) return;
  const [ux, uy] = [dx / length, dy / length];
  const head = 4 * width;
  line(ctx, x, y, x + dx - ux * head, y + dy - uy * head, colour, width);
  ctx.beginPath();
  ctx.moveTo(x + dx, y + dy);
  ctx.lineTo(x + dx - ux * head - uy * head * 0.6, y + dy - uy * head + ux * head * 0.6);
  ctx.lineTo(x + dx - ux * head + uy * head * 0.6, y + dy - uy * head - ux * head * 0.6);
  ctx.closePath();
  paint(ctx, colour, null, 0);
}

export function text(ctx, words, x, y, size, colour, align = "center", weight = 600) {
  ctx.font = `${weight} ${size}px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif`;
  ctx.textAlign = align;
  ctx.textBaseline = "middle";
  ctx.fillStyle = colour;
  ctx.fillText(words, x, y);
}

function paint(ctx, fill, edge, width) {
  if (fill) {
    ctx.fillStyle = fill;
    ctx.fill();
  }
  if (edge) {
    ctx.strokeStyle = edge;
    ctx.lineWidth = width;
    ctx.stroke();
  }
}

// The hand is a blue disc with the patient's hand on it, seen from above; side: "left" or "right".
export function drawHand(ctx, x, y, radius, side) {
  disc(ctx, x, y, radius + 0.14 * radius, "#ffffff", INK, Math.max(1, 0.04 * radius));
  disc(ctx, x, y, radius, BLUE);
  drawPalm(ctx, x, y, radius, side);
}

const FINGERS = [[-0.25, -0.46], [-0.09, -0.6], [0.09, -0.56], [0.26, -0.36]]; // tips, of a right hand

export function drawPalm(ctx, x, y, size, side) {
  const at = side === "left" ? -size : size;
  for (const [fx, fy] of FINGERS) line(ctx, x + 0.85 * fx * at, y + 0.1 * size, x + fx * at, y + fy * size, "#ffffff", 0.14 * size);
  line(ctx, x - 0.2 * at, y + 0.32 * size, x - 0.54 * at, y, "#ffffff", 0.16 * size);
  line(ctx, x - 0.12 * at, y + 0.24 * size, x + 0.12 * at, y + 0.24 * size, "#ffffff", 0.44 * size);
}

const PETALS = [PURPLE, SKY, YELLOW]; // of those that bloom for the first, second, third time

// A flower for a target that was reached, open by a share of 0 to 1.
export function drawFlower(ctx, x, y, radius, times, open = 1) {
  const colour = PETALS[(times - 1) % PETALS.length];
  for (let i = 0; i < 6; i++) {
    const [dx, dy] = [Math.sin((i * Math.PI) / 3), Math.cos((i * Math.PI) / 3)].map((v) => 0.68 * open * radius * v);
    disc(ctx, x + dx, y + dy, 0.42 * radius, colour, INK, 0.06 * radius);
  }
  disc(ctx, x, y, 0.42 * radius, "#ffffff", INK, 0.06 * radius);
}

// Draws where the hand is to go in this phase of a trial: the start is a ring, the target an orange
// diamond, what was reached a tick in a flower that opens, by the share `bloom`.
export function drawGoal(ctx, x, y, radius, state, bloom = 1) {
  if (state.phase === PREPARE) {
    disc(ctx, x, y, 1.1 * radius, "#ffffff", INK, 0.2 * radius);
    return;
  }
  if (state.phase === REACHED) {
    drawFlower(ctx, x, y, (1.4 + bloom) * radius, 1, bloom);
    disc(ctx, x, y, 1.15 * radius, GREEN, "#ffffff", 0.1 * radius);
    tick(ctx, x, y, radius, "#ffffff");
    return;
  }
  diamond(ctx, x, y, 1.3 * radius, ORANGE, INK, 0.12 * radius);
  const since = state.since ?? 0;
  if (state.phase === MOVING || state.phase === OVER_TIME) {
    const colour = state.phase === MOVING ? INK : VERMILLION;
    arc(ctx, x, y, 1.6 * radius, since / Math.max(state.duration, 0.1), colour, 0.16 * radius);
  }
}
