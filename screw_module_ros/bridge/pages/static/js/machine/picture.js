// SPDX-License-Identifier: Apache-2.0
// Solids as polygons in a picture: seen in perspective, the face whose middle is farthest first (painter's
// way). Long solids are cut, or what is near one of their ends would be hidden by the other.
// A solid is { kind: "box" | "cylinder" | "ball", size, rgb, pose, cut }: a box's three edges, a cylinder's
// radius and length along z, a ball's radius; cut: largest length of its pieces [m];
// open: without a top, where another solid lies on it.

import { plus, pointAt } from "./kinematics.js";

const SIDES = 14; // of a cylinder
const MOST_KEPT = 500;
const THIN = 0.016, LONGEST = 0.06; // of a piece, half of it for what is thin [m]
const LIGHT = unit([-0.45, -0.35, 0.82]);
const DARKEST = 0.52; // of a face that the light does not reach

const minus = (a, b) => a.map((value, i) => value - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function unit(a) {
  const length = Math.hypot(...a);
  return a.map((value) => value / length);
}

// How to see from `eye` to `at` [m] in a picture of this size; `tall`: what it shows there [m].
export function camera(eye, at, width, height, tall) {
  const forward = unit(minus(at, eye));
  const right = unit(cross(forward, [0, 0, 1]));
  return {
    eye, forward, right, up: cross(right, forward), cx: width / 2, cy: height / 2,
    focus: (height / tall) * Math.hypot(...minus(at, eye)),
  };
}

// Returns [x, y, distance, pixels per metre] of a point in the picture.
export function seenAt({ eye, forward, right, up, cx, cy, focus }, point) {
  const from = minus(point, eye);
  const scale = focus / dot(from, forward);
  return [cx + scale * dot(from, right), cy - scale * dot(from, up), Math.hypot(...from), scale];
}

// Faces of a convex piece: corners in the solid's frame, and which edges are the solid's own.
function boxFaces([x, y, z], cut) {
  const faces = [];
  [x, y, z].forEach((_, axis) => {
    const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    const sizes = [x, y, z];
    const [nu, nv] = [u, v].map((i) => Math.max(1, Math.ceil(sizes[i] / cut)));
    for (const sign of [-1, 1]) {
      for (let i = 0; i < nu; i++) {
        for (let j = 0; j < nv; j++) {
          const corner = (a, b) => {
            const point = [0, 0, 0];
            point[axis] = (sign * sizes[axis]) / 2;
            point[u] = (a / nu - 0.5) * sizes[u];
            point[v] = (b / nv - 0.5) * sizes[v];
            return point;
          };
          const ring = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
          const own = [j === 0, i + 1 === nu, j + 1 === nv, i === 0];
          faces.push({ ring: sign > 0 ? ring : ring.reverse(), own: sign > 0 ? own : [own[2], own[1], own[0], own[3]] });
        }
      }
    }
  });
  return faces;
}

function cylinderFaces([radius, length], cut) {
  const around = Array.from({ length: SIDES }, (_, k) => {
    const angle = (2 * Math.PI * k) / SIDES;
    return [radius * Math.cos(angle), radius * Math.sin(angle)];
  });
  const faces = [];
  const pieces = Math.max(1, Math.ceil(length / cut));
  for (let n = 0; n < pieces; n++) {
    const [low, high] = [n, n + 1].map((k) => (k / pieces - 0.5) * length);
    around.forEach((a, k) => {
      const b = around[(k + 1) % SIDES];
      faces.push({ ring: [[...a, low], [...b, low], [...b, high], [...a, high]], own: [n === 0, false, n + 1 === pieces, false] });
    });
  }
  const whole = Array(SIDES).fill(true);
  faces.push({ ring: around.map((a) => [...a, length / 2]), own: whole });
  faces.push({ ring: around.map((a) => [...a, -length / 2]).reverse(), own: whole });
  return faces;
}

const FACES = { box: boxFaces, cylinder: cylinderFaces };
const kept = new Map(); // faces do not change with the pose

function facesOf({ kind, size, cut = Math.min(...size) < THIN ? LONGEST / 2 : LONGEST }) {
  const key = `${kind} ${size} ${cut}`;
  if (kept.size > MOST_KEPT) kept.clear(); // of a limb that moves the length is always new
  if (!kept.has(key)) kept.set(key, FACES[kind](size, cut));
  return kept.get(key);
}

const shade = (rgb, light) => `#${rgb.map((part) =>
  Math.round(255 * Math.min(1, part * light)).toString(16).padStart(2, "0")).join("")}`;

// Returns what to paint, the farthest first: { points, fill, lines, edge } or { x, y, radius, fill, edge }.
export function painted(solids, view) {
  const found = [];
  for (const solid of solids) {
    const { kind, pose, rgb } = solid;
    if (kind === "ball") {
      const [x, y, far, scale] = seenAt(view, pose.at);
      found.push({ far: far - solid.size[0], x, y, radius: solid.size[0] * scale, fill: shade(rgb, 0.9), edge: shade(rgb, 0.62) });
      continue;
    }
    for (const { ring, own } of facesOf(solid)) {
      const corners = ring.map((corner) => pointAt(pose, corner));
      const normal = unit(cross(minus(corners[1], corners[0]), minus(corners[2], corners[1])));
      if (dot(normal, minus(corners[0], view.eye)) >= 0) continue; // it looks away
      if (solid.open && normal[2] > 0.9) continue;
      const points = corners.map((corner) => seenAt(view, corner));
      const light = DARKEST + (1 - DARKEST) * Math.max(0, dot(normal, LIGHT)) + 0.12 * normal[2];
      const centre = corners.reduce(plus).map((sum) => sum / corners.length);
      found.push({
        far: Math.hypot(...minus(centre, view.eye)), points, fill: shade(rgb, light), edge: shade(rgb, 0.42),
        lines: own.flatMap((is, k) => (is ? [[points[k], points[(k + 1) % points.length]]] : [])),
      });
    }
  }
  return found.sort((one, other) => other.far - one.far);
}

export function paint(ctx, solids, view) {
  ctx.lineJoin = "round";
  for (const { points, lines, x, y, radius, fill, edge } of painted(solids, view)) {
    ctx.beginPath();
    if (points) for (const [a, b] of points) ctx.lineTo(a, b);
    else ctx.arc(x, y, radius, 0, 2 * Math.PI);
    ctx.closePath();
    ctx.fillStyle = ctx.strokeStyle = fill;
    ctx.lineWidth = 0.7; // closes the seams between pieces
    ctx.fill();
    ctx.stroke();
    if (points) {
      ctx.beginPath();
      for (const [from, to] of lines) {
        ctx.moveTo(from[0], from[1]);
        ctx.lineTo(to[0], to[1]);
      }
    }
    ctx.strokeStyle = edge;
    ctx.stroke();
  }
}
