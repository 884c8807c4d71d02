// SPDX-License-Identifier: Apache-2.0
// Where the machine's links are, as its URDF has them: `parts.js` is made from it by tools/picture.py.
// Poses are { turn: 3 x 3 by rows, at: [x, y, z] } in the frame manus_base; metres, radians.

import { MACHINE } from "./parts.js";

const IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const times = (a, b) => a.map((row) => b[0].map((_, j) => row.reduce((sum, value, k) => sum + value * b[k][j], 0)));
const turned = (turn, v) => turn.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

export const plus = (a, b) => a.map((value, i) => value + b[i]);
export const pointAt = ({ turn, at }, point) => plus(at, turned(turn, point));
export const after = (pose, { turn, at }) => ({ turn: times(pose.turn, turn), at: pointAt(pose, at) });

// The rotation about a unit axis (Rodrigues).
export function rotation([x, y, z], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const across = [[0, -z, y], [z, 0, -x], [-y, x, 0]];
  const twice = times(across, across);
  return IDENTITY.map((row, i) => row.map((one, j) => one + s * across[i][j] + (1 - c) * twice[i][j]));
}

// About the fixed axes x, y and z, one after the other.
export function rollPitchYaw([roll, pitch, yaw]) {
  return times(rotation([0, 0, 1], yaw), times(rotation([0, 1, 0], pitch), rotation([1, 0, 0], roll)));
}

// Values of the driven joints with the handle at a place; out of reach, the arm points there.
export function jointsAt(x, y, z) {
  const { upper_arm: first, forearm: second, base_x: left, base_y: far, turn } = MACHINE.arm;
  const [dx, dy] = [x - left, y - far];
  const cosine = (dx * dx + dy * dy - first * first - second * second) / (2 * first * second);
  const elbow = turn * Math.acos(Math.min(1, Math.max(-1, cosine)));
  const shoulder = Math.atan2(dy, dx) - Math.atan2(second * Math.sin(elbow), first + second * Math.cos(elbow));
  return { shoulder, elbow, vertical: z };
}

// The pose of each link for values of the driven joints. Joints stand with the parent's first.
export function posesOf(values) {
  const poses = { [MACHINE.root]: { turn: IDENTITY, at: [0, 0, 0] } };
  for (const { type, parent, child, xyz, rpy, axis, of, ratio } of MACHINE.joints) {
    const value = ratio * (values[of] ?? 0);
    const move = type === "prismatic"
      ? { turn: IDENTITY, at: axis.map((part) => part * value) }
      : { turn: type === "fixed" ? IDENTITY : rotation(axis, value), at: [0, 0, 0] };
    poses[child] = after(after(poses[parent], { turn: rollPitchYaw(rpy), at: xyz }), move);
  }
  return poses;
}

// The machine's solids with the handle at a place, in the frame manus_base.
export function machineAt(x, y, z) {
  const poses = posesOf(jointsAt(x, y, z));
  return MACHINE.solids.map(({ link, at, rpy, ...solid }) => (
    { ...solid, pose: after(poses[link], { turn: rollPitchYaw(rpy), at }) }));
}
