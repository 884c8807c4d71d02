// SPDX-License-Identifier: Apache-2.0
// A canvas that is as sharp as its screen, whatever its size becomes.

const MOST_PIXELS = 4.2e6; // beyond it a picture costs more time than sharpness is worth

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
