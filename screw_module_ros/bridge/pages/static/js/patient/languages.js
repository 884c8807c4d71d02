// SPDX-License-Identifier: Apache-2.0
// The sentences of the patient's screen, in each of its languages with the same keys. Those of the therapist's pages
// are in `words.js` and `cells.js`, and in German in `german.js`.

const ENGLISH = {
  other: "Deutsch",
  picture: "Where the hand is and where it is to go",
  progress: "Movements done",
  hands: { left: "Hand: left", right: "Hand: right" },
  dims: "This screen may dim or switch itself off: set it so that it stays on.",
  stop: "Please stop", unheard: "The robot does not hear it: tell your therapist",
  back: "Back", full: "Full screen", soundOn: "Sound: on", soundOff: "Sound: off",
  menu: "What shall we do?", hint: "Touch a picture to play. The therapist starts the exercises.",
  fruit: "Pick fruit", free: "Move freely", freely: "Move the blue hand wherever you like", start: "start",
  // By the constants of TherapyState.msg: question, meaning of 0 and of 10.
  questions: {
    1: ["How much pain do you feel now?", "0: none", "10: the worst that you can think of"],
    2: ["How tired are you now?", "0: not at all", "10: as tired as can be"],
  },
  waiting: "One moment …", forRobot: "Waiting for the robot", connecting: "Connecting to the robot",
  silent: "It does not tell anything yet", ceased: "The exercise has stopped", stopped: "The robot has stopped",
  askTherapist: "Your therapist knows what to do",
  handsOff: ["Hands off the handle", "Only for a moment"],
  strapped: ["Your arm is strapped in", "Lay it down, and let it rest"],
  hang: ["Let your arm hang", "Loose and heavy: the robot moves it to three places"],
  begins: "The exercise is about to begin",
  rest: "A rest", goesOn: (seconds) => `It goes on in ${seconds} s`,
  pause: "Pause", own: "As you asked. Tell your therapist why", paused: "The therapist goes on in a moment",
  finished: "Finished. Thank you!", ended: "The exercise has ended",
  reached: (count) => `${count} target${count === 1 ? "" : "s"} reached`,
  reachedOf: (count, all) => `${count} of ${all} targets reached`,
  tasks: {
    reach: "Move the blue hand to the orange diamond", circle: "Draw circles along the orange line",
    hold: "Hold your hand still", resisted: "Keep the blue hand on the orange diamond",
    strength: "Push in the direction of the arrow",
  },
  lift: "Lift the elevator to the person", lower: "Lower the elevator to the person",
  ready: "Get ready", relax: "Relax: the robot moves your hand", wellDone: "Well done", takeTime: "Take your time",
  noRobot: (asked) => `There is no robot ${asked} here: ask for the right address.`,
  toFruit: "Move the blue hand to the fruit", seasons: ["Spring", "Summer", "Autumn", "Winter"],
  points: (score, season, basket) => `${score} points · ${season}, basket ${basket}`,
  row: (count) => ` · ${count} in a row`,
};

const GERMAN = {
  other: "English",
  picture: "Wo die Hand ist und wohin sie soll",
  progress: "Gemachte Bewegungen",
  hands: { left: "Hand: links", right: "Hand: rechts" },
  dims: "Dieser Bildschirm kann dunkel werden: bitte so einstellen, dass er an bleibt.",
  stop: "Bitte anhalten", unheard: "Der Roboter hört es nicht: sagen Sie es der Therapeutin",
  back: "Zurück", full: "Vollbild", soundOn: "Ton: an", soundOff: "Ton: aus",
  menu: "Was machen wir?", hint: "Zum Spielen ein Bild berühren. Die Übungen beginnt die Therapeutin.",
  fruit: "Obst pflücken", free: "Frei bewegen", freely: "Bewegen Sie die blaue Hand, wohin Sie mögen", start: "Start",
  questions: {
    1: ["Wie stark sind Ihre Schmerzen jetzt?", "0: keine", "10: die stärksten, die Sie sich vorstellen können"],
    2: ["Wie müde sind Sie jetzt?", "0: gar nicht", "10: so müde wie nur möglich"],
  },
  waiting: "Einen Moment …", forRobot: "Der Roboter ist noch nicht so weit", connecting: "Die Verbindung wird aufgebaut",
  silent: "Er meldet noch nichts", ceased: "Die Übung steht", stopped: "Der Roboter hat angehalten",
  askTherapist: "Die Therapeutin weiß, was zu tun ist",
  handsOff: ["Hände weg vom Griff", "Nur für einen Moment"],
  strapped: ["Ihr Arm ist festgeschnallt", "Legen Sie ihn ab und lassen Sie ihn ruhen"],
  hang: ["Lassen Sie den Arm hängen", "Locker und schwer: der Roboter führt ihn an drei Orte"],
  begins: "Gleich geht es los",
  rest: "Eine Rast", goesOn: (seconds) => `Weiter in ${seconds} s`,
  pause: "Pause", own: "Wie Sie es wollten. Sagen Sie der Therapeutin, warum", paused: "Die Therapeutin macht gleich weiter",
  finished: "Geschafft. Danke!", ended: "Die Übung ist zu Ende",
  reached: (count) => `${count} ${count === 1 ? "Ziel" : "Ziele"} erreicht`,
  reachedOf: (count, all) => `${count} von ${all} Zielen erreicht`,
  tasks: {
    reach: "Die blaue Hand zur orangen Raute", circle: "Kreise auf der orangen Linie",
    hold: "Die Hand still halten", resisted: "Die blaue Hand auf der orangen Raute halten",
    strength: "In Richtung des Pfeils drücken",
  },
  lift: "Den Aufzug hinauf zur Person", lower: "Den Aufzug hinunter zur Person",
  ready: "Gleich geht es los", relax: "Locker lassen: der Roboter führt Ihre Hand", wellDone: "Gut gemacht",
  takeTime: "Lassen Sie sich Zeit",
  noRobot: (asked) => `Hier gibt es keinen Roboter ${asked}: fragen Sie nach der richtigen Adresse.`,
  toFruit: "Die blaue Hand zur Frucht", seasons: ["Frühling", "Sommer", "Herbst", "Winter"],
  points: (score, season, basket) => `${score} Punkte · ${season}, Korb ${basket}`,
  row: (count) => ` · ${count} in Folge`,
};

export const LANGUAGES = { en: ENGLISH, de: GERMAN };
const KEY = "language"; // of this screen, for whoever sits there

// The language that was chosen at this screen, English before.
export function chosenLanguage() {
  return globalThis.localStorage?.getItem?.(KEY) === "de" ? "de" : "en";
}

// Changes to the other language; the page is loaded again, which a session does not notice.
export function changeLanguage() {
  localStorage.setItem(KEY, chosenLanguage() === "de" ? "en" : "de");
  location.reload();
}
