// SPDX-License-Identifier: Apache-2.0
// Prints the drawing of README: the machine, the seated patient, and the names of the parts.
// node tools/picture.mjs FOLDER, with the folder of the pages' modules of the machine.

import { pathToFileURL } from "node:url";

const folder = pathToFileURL(`${process.argv[2]}/`);
const { jointsAt, machineAt, pointAt, posesOf } = await import(new URL("kinematics.js", folder));
const { camera, painted, seenAt } = await import(new URL("picture.js", folder));
const { patient, table } = await import(new URL("seated.js", folder));

const WIDTH = 1000, HEIGHT = 640;
const HAND = [-0.02, 0.0, 0.10];
const view = camera([-3.0, -1.5, 1.6], [-0.04, 0.0, -0.06], WIDTH, HEIGHT, 1.5);
const poses = posesOf(jointsAt(...HAND));

// Words, the link and the point in it that they name, and where they stand in the picture.
const NAMES = [
  ["shoulder motor", "manus_base", [-0.05, 0.55, 0.28], 150, 60],
  ["elbow motor", "manus_base", [-0.05, 0.55, -0.04], 150, 300],
  ["upper arm", "upper_arm", [0.27, 0, 0.17], 300, 60],
  ["coupler", "coupler", [0.24, 0, 0.02], 385, 236],
  ["crank", "crank", [-0.03, 0.0125, 0.055], 150, 215],
  ["forearm", "forearm", [0.2, 0.02, 0.1], 400, 60],
  ["motor, encoder on top", "module", [0.03, 0, 0.55], 560, 40],
  ["flexible coupling", "module", [0.012, 0, 0.46], 560, 75],
  ["U-channel with rail", "module", [0.0, -0.03, 0.36], 560, 110],
  ["screw", "screw", [0, 0, 0.28], 560, 145],
  ["nut on its ball carriage", "carriage", [0.02, 0, 0.01], 440, 336],
  ["force sensor", "carriage", [0.078, -0.01, -0.003], 560, 330],
  ["handle", "grip", [0, 0, 0.13], 560, 180],
  ["cradle", "handle", [0.03, -0.2, 0.03], 600, 360],
];

// A path by steps, which are shorter to write.
function path(points, close = "z") {
  let last = [0, 0];
  return points.map(([x, y], i) => {
    const now = [Math.round(10 * x), Math.round(10 * y)];
    const step = `${i === 0 ? "M" : i === 1 ? "l" : " "}${(now[0] - last[0]) / 10} ${(now[1] - last[1]) / 10}`;
    last = now;
    return step;
  }).join("") + close;
}

const n = (value) => value.toFixed(1);
const body = [];
for (const { points, lines, x, y, radius, fill, edge } of painted([...table(), ...patient(...HAND), ...machineAt(...HAND)], view)) {
  if (points) {
    body.push(`<path d="${path(points)}" fill="${fill}" stroke="${fill}"/>`);
    if (lines.length) body.push(`<path d="${lines.map((line) => path(line, "")).join("")}" stroke="${edge}"/>`);
  } else body.push(`<circle cx="${n(x)}" cy="${n(y)}" r="${n(radius)}" fill="${fill}" stroke="${edge}"/>`);
}
for (const [words, link, at, x, y] of NAMES) {
  const [a, b] = seenAt(view, pointAt(poses[link], at));
  const end = x > a ? "start" : "end";
  body.push(`<path d="M${n(a)} ${n(b)}L${x} ${y}" stroke="#16212b"/><circle cx="${n(a)}" cy="${n(b)}" r="2.2" fill="#16212b"/>`);
  body.push(`<text x="${x + (x > a ? 4 : -4)}" y="${y + 4}" text-anchor="${end}" fill="#16212b">${words}</text>`);
}
console.log(`<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${WIDTH} ${HEIGHT}" width="${WIDTH}" height="${HEIGHT}" stroke-width="0.7" stroke-linejoin="round" fill="none" font-family="sans-serif" font-size="14">
<title>MIT-MANUS with the vertical module, and a seated patient</title>
<rect width="${WIDTH}" height="${HEIGHT}" fill="#f7f5ef"/>
<g>${body.join("\n")}</g>
</svg>`);
