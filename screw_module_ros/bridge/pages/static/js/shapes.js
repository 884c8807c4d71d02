// SPDX-License-Identifier: Apache-2.0
// Shapes on a canvas, sizes in its pixels.

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
  ctx.lineCap = ctx.lineJoin = "round";
  paint(ctx, null, colour, 0.22 * radius);
}

export function line(ctx, x1, y1, x2, y2, colour, width, dash = []) {
  ctx.beginPath();
  ctx.setLineDash(dash);
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
