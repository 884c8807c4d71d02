// SPDX-License-Identifier: Apache-2.0
// The connection to the bridge: states of its messages, the page's token, and a client of the subset
// of rosbridge v2 that the pages need, which connects again by itself. Subscriptions are made anew with
// each connection; a call is not repeated. Errors name their kind as `cause`; `words` has the sentences.

// Constants of TherapyState.msg and SafetyState.msg.
export const IDLE = 0, RUNNING = 1, PAUSED = 2, FINISHED = 3, ABORTED = 4, STARTING = 5;
export const NONE = 0, PREPARE = 1, WAIT = 2, MOVING = 3, OVER_TIME = 4, REACHED = 5;
export const SAFETY_OK = 0, SAFETY_WAITING = 1, SAFETY_STOPPED = 2;

// Whether a session is under way; state: a TherapyState, null before the first.
export function isUnderWay(state) {
  return [STARTING, RUNNING, PAUSED].includes(state?.state);
}

// Whether it rests: a pause that ends by itself.
export function isResting(state) {
  return state?.state === PAUSED && state.rest != null;
}

// Whether an arm is being weighed; its phase: NONE the cradle is empty, WAIT for the strap, MOVING it hangs.
export function isWeighed(state) {
  return state?.kind === "weigh" && !isUnderWay(state);
}

// Whether a game is played in a session.
export function isPlayed(state) {
  return state?.kind === "game" && isUnderWay(state);
}

// A point of a protocol as it stands for an arm: for the left one the protocol's centre is mirrored in x.
export function sided(protocol, side, point) {
  if (side !== "left" || !protocol.centre) return point;
  const [x, y, z] = point;
  return [x - 2 * protocol.centre[0], y, z];
}

// The targets of the block that runs: those of all blocks together would overlap.
export function targetsOf(protocol, { block, side }) {
  const { blocks = {}, targets = [] } = protocol ?? {};
  return (Object.hasOwn(blocks, block) ? blocks[block] : targets).map((point) => sided(protocol, side, point));
}

const FIRST_PAUSE_MS = 300;
const LONGEST_PAUSE_MS = 4000;
const ANSWER_MS = 10000;

export class Bridge {
  // changed(isOpen, sentence): called when the connection comes and goes.
  constructor(token, changed = () => {}) {
    this.token = token;
    this.changed = changed;
    this.isOpen = false;
    this.topics = new Map();
    this.calls = new Map();
    this.count = 0;
    this.pause = FIRST_PAUSE_MS;
    this.sentence = "";
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const address = `${scheme}://${location.host}/ws?token=${encodeURIComponent(this.token)}`;
    this.socket = new WebSocket(address);
    this.socket.onopen = () => this.opened();
    this.socket.onmessage = (event) => this.take(JSON.parse(event.data));
    this.socket.onclose = () => this.closed();
  }

  opened() {
    this.isOpen = true;
    this.pause = FIRST_PAUSE_MS;
    this.sentence = "";
    for (const [topic, { throttle }] of this.topics) this.ask(topic, throttle);
    this.changed(true, "");
  }

  closed() {
    const was = this.isOpen;
    this.isOpen = false;
    for (const { reject, timer } of this.calls.values()) {
      clearTimeout(timer);
      reject(new Error("", { cause: "lost" }));
    }
    this.calls.clear();
    this.changed(false, this.sentence);
    setTimeout(() => this.connect(), was && !this.sentence ? FIRST_PAUSE_MS : this.pause);
    this.pause = Math.min(2 * this.pause, LONGEST_PAUSE_MS);
  }

  take(message) {
    if (message.op === "publish") {
      this.topics.get(message.topic)?.heard(message.msg);
    } else if (message.op === "service_response") {
      const call = this.calls.get(message.id);
      this.calls.delete(message.id);
      clearTimeout(call?.timer);
      if (message.result) call?.resolve(message.values);
      else call?.reject(new Error(String(message.values)));
    } else if (message.op === "status" && message.level === "error") {
      this.sentence = message.msg;
      this.changed(this.isOpen, message.msg);
    }
  }

  // heard(message): called with each message that comes, at most every `throttle` ms.
  subscribe(topic, heard, throttle = 0) {
    this.topics.set(topic, { heard, throttle });
    if (this.isOpen) this.ask(topic, throttle);
  }

  ask(topic, throttle) {
    this.send({ op: "subscribe", topic, throttle_rate: throttle });
  }

  publish(topic, msg) {
    if (this.isOpen) this.send({ op: "publish", topic, msg });
  }

  // Returns a promise of the response's fields.
  call(service, args = {}) {
    if (!this.isOpen) return Promise.reject(new Error("", { cause: "closed" }));
    const id = `call${++this.count}`;
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this.calls.delete(id);
        reject(new Error(service, { cause: "unanswered" }));
      }, ANSWER_MS);
      this.calls.set(id, { resolve, reject, timer });
      this.send({ op: "call_service", service, args, id });
    });
  }

  send(content) {
    this.socket.send(JSON.stringify(content));
  }
}

// Returns what the bridge tells of itself: role, robots, protocols, measures. Throws an Error; `final` on
// it: it makes no sense to ask again.
async function configuration(token) {
  let answer;
  try {
    answer = await fetch("/config.json", { headers: { Authorization: `Bearer ${token}` } });
  } catch {
    throw new Error("", { cause: "silent" });
  }
  if (!answer.ok) {
    const error = new Error((await answer.text()).trim(), { cause: "refused" });
    error.final = answer.status === 403;
    throw error;
  }
  return answer.json();
}

// The same, asked again until there is an answer; told(error) gets what is wrong meanwhile.
export async function configurationAtLast(token, told) {
  for (;;) {
    try {
      return await configuration(token);
    } catch (error) {
      told(error);
      if (error.final) throw error;
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }
}

// Returns which of the robots an address asks for, as right or /right; the first if for none, undefined
// if for one that is not there: another one's hand would be shown.
export function chosenRobot(robots, asked) {
  return asked ? robots.find((robot) => [robot, robot.slice(1)].includes(asked)) : robots[0];
}

export function named(robot, name) {
  return `${robot === "/" ? "" : robot}/${name}`;
}

// Tells which button of an element was pressed, for the action log: those that have a name, as they ask
// nothing of the robot; the bridge tells of the others itself. Before the button acts: it may load the page anew.
export function tellPresses(element, tell) {
  element.addEventListener("click", ({ target }) => {
    const { name } = target.closest("button") ?? {};
    if (name) tell("therapy/action", { msg: name });
  }, true);
}

// The token comes behind the # of the address, which a browser sends to nobody. It is kept for this
// tab, so that a reload works, and taken out of the address bar, where others could read it.
export function ownToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem("token", given);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem("token") ?? "";
}
