// SPDX-License-Identifier: Apache-2.0
// Picking fruit in three dimensions. No clock runs against the patient: who is slow gets nearer and
// larger fruit, who is quick gets them farther apart, swinging in the wind, and golden ones.

import { BLUE, GREEN, INK, ORANGE, PURPLE, VERMILLION, YELLOW, disc, drawHand, text } from "../draw.js";
import { RADIUS, camera, drawFloor, drawPost, drawWay, seen } from "../space.js";
import { gameLine } from "../words.js";

const FULL = 8; // fruit in a basket
const STREAK = 5; // fruit in a row from which each is worth one more
const SEASONS = [ // sky and ground in spring, summer, autumn and winter
  ["#e8f3e4", "#d3e6cc"], ["#fdf3d3", "#f3e3ad"], ["#f9e6d2", "#ecd0b0"], ["#e6eff5", "#cfdfe9"],
];
const QUICK = 3.0, SLOW = 6.0; // time from fruit to fruit [s]
const LEAST_REACH = 0.05, MOST_REACH = 0.17; // from the hand to the next fruit [m]
const LEAST_RADIUS = 0.022, MOST_RADIUS = 0.04; // within which a fruit is picked [m]
const ROOM = [[-0.13, 0.13], [-0.1, 0.13], [0.07, 0.29]]; // where fruit grows [m]
const LEAVES = "#8fc9b1";
const FLIGHT = 0.8; // of a fruit into the basket [s]
const LEAD = 0.05; // how far ahead of the hand the wish pulls [m]
const BASKET = { portrait: 0.8, landscape: 0.9 }; // its place, of the height: above the buttons

export class FruitGame {
  // level: 0 the nearest and largest fruit at first, 1 the farthest and smallest.
  constructor(random = Math.random, level = 1 / 3) {
    this.random = random;
    this.score = this.picked = this.streak = 0;
    this.reach = LEAST_REACH + level * (MOST_REACH - LEAST_REACH);
    this.radius = MOST_RADIUS - level * (MOST_RADIUS - LEAST_RADIUS);
    this.minute = this.since = this.before = 0; // of a session
    this.age = 0;
    this.fruit = null;
    this.flying = [];
    this.gathered = []; // kinds of fruit in the basket
    this.isStill = false; // no motion but the hand's
    this.basketAt = 0.1; // of the width
    this.sound = () => {};
  }

  get basket() {
    return Math.floor(this.picked / FULL);
  }

  get season() {
    return SEASONS[this.basket % SEASONS.length];
  }

  get wind() {
    return this.basket < 2 || this.isStill ? 0 : Math.min(0.004 * (this.basket - 1), 0.02);
  }

  // Where the fruit is now [m]: it swings in the wind.
  get place() {
    const { at, phase } = this.fruit;
    return [at[0] + this.wind * Math.sin(1.3 * this.age + phase), at[1], at[2]];
  }

  // Goes on by dt [s] with the hand at [x, y, z] [m], null where that is not known.
  step(dt, hand) {
    this.flying = this.flying.filter((each) => (each.age += dt) < FLIGHT);
    if (!hand) return;
    this.age += dt;
    if (!this.fruit) this.grow(hand);
    if (Math.hypot(...this.place.map((value, i) => value - hand[i])) < this.radius) this.pick(hand);
  }

  pick(hand) {
    const took = this.age;
    this.streak = took < SLOW ? this.streak + 1 : 0;
    const worth = this.fruit.kind.worth + (this.streak >= STREAK ? 1 : 0);
    this.score += worth;
    this.picked += 1;
    this.flying.push({ from: this.place, kind: this.fruit.kind, worth, age: 0 });
    if (this.gathered.length === FULL) this.gathered = [];
    this.gathered.push(this.fruit.kind);
    this.adapt(took);
    this.sound(this.picked % FULL === 0 ? "basket" : "pick");
    this.grow(hand);
  }

  adapt(took) {
    const way = took < QUICK ? 1 : took > SLOW ? -1 : 0;
    this.reach = Math.min(Math.max(this.reach + 0.012 * way, LEAST_REACH), MOST_REACH);
    this.radius = Math.min(Math.max(this.radius - 0.002 * way, LEAST_RADIUS), MOST_RADIUS);
  }

  grow(hand) {
    const golden = this.picked > 3 && this.random() < 1 / 6;
    const kind = golden ? KINDS.golden : Object.values(KINDS)[Math.floor(4 * this.random())];
    this.fruit = { at: this.somewhere(hand), kind, phase: 6 * this.random() };
    this.age = 0;
  }

  // A point about `reach` from the hand, within the room.
  somewhere(hand) {
    let best = null;
    for (let tries = 0; tries < 12; tries++) {
      const point = ROOM.map(([low, high]) => low + (high - low) * this.random());
      const miss = Math.abs(Math.hypot(...point.map((v, i) => v - hand[i])) - this.reach);
      if (!best || miss < best.miss) best = { point, miss };
    }
    return best.point;
  }

  // Where the robot is wished to pull [m]: a little ahead of the hand, towards the fruit.
  wish(hand) {
    if (!this.fruit || !hand) return null;
    const way = this.place.map((value, i) => value - hand[i]);
    const share = Math.min(1, LEAD / Math.max(Math.hypot(...way), 1e-9));
    return hand.map((value, i) => value + share * way[i]);
  }

  // How well a minute of a session goes, 0 to 1: the fruit in it, of one each QUICK seconds. since: its beginning [s].
  share(minute, since) {
    if (minute !== this.minute || since < this.since) this.before = this.picked;
    [this.minute, this.since] = [minute, since];
    return Math.min(1, (QUICK * (this.picked - this.before)) / Math.max(since, QUICK));
  }

  tell() {}

  close() {}

  draw({ ctx, width, height }, hand, side) {
    const view = camera(width, height);
    const [sky, ground] = this.season;
    ctx.fillStyle = sky;
    ctx.fillRect(0, 0, width, height);
    drawFloor(ctx, view, "rgb(255 255 255 / 55%)", ground);
    this.drawTree(ctx, view);
    const things = [];
    if (this.fruit) {
      const radius = Math.max(this.radius, RADIUS);
      things.push({ point: this.place, radius, colour: GREEN,
        draw: ({ x, y, scale }) => drawFruit(ctx, this.fruit.kind, x, y, radius * scale) });
    }
    if (hand) {
      things.push({ point: hand, radius: RADIUS, colour: BLUE,
        draw: ({ x, y, scale }) => drawHand(ctx, x, y, RADIUS * scale, side) });
    }
    things.sort((one, other) => other.point[1] - one.point[1]); // what is far away first
    for (const { point, radius, colour } of things) drawPost(ctx, view, point, radius, colour);
    if (things.length === 2) drawWay(ctx, view, hand, this.place, INK);
    for (const { point, draw } of things) draw(seen(view, point));
    for (const each of this.flying) this.drawPicked(ctx, view, each, width, height);
    this.drawScore(ctx, width, height);
  }

  drawTree(ctx, view) {
    const [foot, top] = [seen(view, [0, 0.19, 0]), seen(view, [0, 0.19, 0.3])];
    ctx.strokeStyle = "#8a6a4f";
    ctx.lineWidth = 0.035 * foot.scale;
    ctx.lineCap = "round";
    ctx.beginPath();
    ctx.moveTo(foot.x, foot.y);
    ctx.lineTo(top.x, top.y);
    ctx.stroke();
    for (const [x, z, size] of [[-0.1, 0.29, 0.08], [0.1, 0.29, 0.08], [0, 0.34, 0.1], [0, 0.25, 0.07]]) {
      const leaf = seen(view, [x, 0.19, z]);
      disc(ctx, leaf.x, leaf.y, size * leaf.scale, LEAVES);
    }
  }

  // A fruit on its way into the basket, with what it was worth.
  drawPicked(ctx, view, { from, kind, worth, age }, width, height) {
    const start = seen(view, from);
    const share = this.isStill ? 0 : Math.min(age / FLIGHT, 1);
    const ease = share * share * (3 - 2 * share);
    const x = start.x + (this.basketAt * width - start.x) * ease;
    const y = start.y + (basketHeight(width, height) - start.y) * ease - 0.12 * height * Math.sin(Math.PI * share);
    if (!this.isStill) drawFruit(ctx, kind, x, y, 0.028 * start.scale * (1 - 0.5 * share));
    text(ctx, `+${worth}`, start.x, start.y - 0.08 * height * (1 + ease), 0.06 * height, INK, "center", 800);
  }

  drawScore(ctx, width, height) {
    const size = Math.min(0.06 * height, 0.07 * width);
    const [x, y] = [Math.max(this.basketAt * width, 2 * size), basketHeight(width, height)];
    this.gathered.forEach((kind, i) =>
      drawFruit(ctx, kind, x + (i % 4 - 1.5) * 0.75 * size, y - (0.75 + 0.6 * Math.floor(i / 4)) * size, 0.42 * size));
    ctx.fillStyle = "#8a5a2b";
    ctx.beginPath();
    ctx.moveTo(x - 1.8 * size, y - 0.5 * size);
    ctx.lineTo(x + 1.8 * size, y - 0.5 * size);
    ctx.lineTo(x + 1.1 * size, y + size);
    ctx.lineTo(x - 1.1 * size, y + size);
    ctx.fill();
    text(ctx, `${this.gathered.length}/${FULL}`, x, y + 0.25 * size, 0.8 * size, "#ffffff");
    const { score, picked, basket, streak } = this;
    const words = gameLine({ score, picked, basket, streak: streak >= STREAK ? streak : 0 });
    ctx.fillStyle = "rgb(255 255 255 / 85%)";
    ctx.fillRect(0, 0, width, 1.7 * size);
    const fitting = (0.94 * width) / (0.62 * words.length); // a letter is 0.62 of its size wide
    text(ctx, words, 0.5 * width, 0.85 * size, Math.min(size, fitting), INK);
  }
}

function basketHeight(width, height) {
  return (width < height ? BASKET.portrait : BASKET.landscape) * height;
}

// The fruit: each kind has a colour and a shape of its own.
const KINDS = {
  apple: { colour: VERMILLION, worth: 1, shape: apple },
  pear: { colour: GREEN, worth: 1, shape: pear },
  plum: { colour: PURPLE, worth: 1, shape: plum },
  lemon: { colour: YELLOW, worth: 1, shape: lemon },
  golden: { colour: ORANGE, worth: 3, shape: star },
};

// With an edge, so that a green pear is seen before green leaves.
function drawFruit(ctx, kind, x, y, radius) {
  kind.shape(ctx, x, y, 1.08 * radius + 1.5, INK);
  kind.shape(ctx, x, y, radius, kind.colour);
}

export function drawApple(ctx, x, y, radius) {
  drawFruit(ctx, KINDS.apple, x, y, radius);
}

function stalk(ctx, x, y, radius) {
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.12 * radius;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.quadraticCurveTo(x, y - 0.3 * radius, x + 0.25 * radius, y - 0.45 * radius);
  ctx.stroke();
}

function apple(ctx, x, y, radius, colour) {
  disc(ctx, x - 0.35 * radius, y, 0.75 * radius, colour);
  disc(ctx, x + 0.35 * radius, y, 0.75 * radius, colour);
  stalk(ctx, x, y - 0.6 * radius, radius);
}

function pear(ctx, x, y, radius, colour) {
  disc(ctx, x, y + 0.25 * radius, 0.75 * radius, colour);
  disc(ctx, x, y - 0.45 * radius, 0.45 * radius, colour);
  stalk(ctx, x, y - 0.85 * radius, radius);
}

function plum(ctx, x, y, radius, colour) {
  ctx.fillStyle = colour;
  ctx.beginPath();
  ctx.ellipse(x, y, 0.95 * radius, 0.65 * radius, 0.5, 0, 2 * Math.PI);
  ctx.fill();
  stalk(ctx, x + 0.1 * radius, y - 0.6 * radius, radius);
}

function lemon(ctx, x, y, radius, colour) {
  ctx.fillStyle = colour;
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.06 * radius;
  ctx.beginPath();
  ctx.moveTo(x - 1.05 * radius, y);
  ctx.quadraticCurveTo(x, y - 1.25 * radius, x + 1.05 * radius, y);
  ctx.quadraticCurveTo(x, y + 1.25 * radius, x - 1.05 * radius, y);
  ctx.fill();
  ctx.stroke();
}

function star(ctx, x, y, radius, colour) {
  ctx.fillStyle = colour;
  ctx.strokeStyle = INK;
  ctx.lineWidth = 0.08 * radius;
  ctx.beginPath();
  for (let i = 0; i < 10; i++) {
    const [r, angle] = [(i % 2 ? 0.5 : 1.1) * radius, (Math.PI * i) / 5 - Math.PI / 2];
    ctx.lineTo(x + r * Math.cos(angle), y + r * Math.sin(angle));
  }
  ctx.closePath();
  ctx.fill();
  ctx.stroke();
}
