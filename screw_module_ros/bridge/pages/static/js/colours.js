// SPDX-License-Identifier: Apache-2.0
// Colours of Okabe and Ito (2008). No meaning hangs on a colour alone: shapes differ too.

export const ORANGE = "#e69f00";
export const SKY = "#56b4e9";
export const GREEN = "#009e73";
export const YELLOW = "#f0e442";
export const BLUE = "#0072b2";
export const VERMILLION = "#d55e00";
export const PURPLE = "#cc79a7";
export const INK = "#16212b";
export const SOFT = "#7d8a95";
export const LINE = "#d5d9dc";
export const PAPER = "#f7f5ef";
