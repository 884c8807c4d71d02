#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Learn an assistance policy in minutes, and judge it beside the shipped adaptation.

    tools/run python examples/learn_assistance.py

The search is the cross-entropy method in numpy: draw policies, let each treat the same patients,
keep the best, draw the next ones around them. All learning is on seeds below 1000; the patients by
which policies are judged are drawn from 10 000 on, and nothing was chosen by them. docs/gym.md
says what came out, and what it does not say.
"""

from __future__ import annotations

import argparse
import math
import time
from concurrent.futures import ProcessPoolExecutor
from statistics import fmean

import numpy as np

from screw_module_ros.gym.environment import ACTIONS, TherapyEnv
from screw_module_ros.therapy.adaptation import Assistance, adapted, circuit_of

PATIENTS = ("weak", "spastic", "synergy", "tiring", "severe")
CIRCUITS = {"reach": 2, "height": 3, "space": 2}
LOW, HIGH = (np.array([getattr(one, end) for one in ACTIONS.values()]) for end in ("low", "high"))
LOW[0] = 0.0  # a policy may carry the arm, not load it
FEATURES = 6  # numbers that a policy sees, each with a weight for each number of the action


def made(task: str) -> TherapyEnv:
    """Return the environment: patients of five kinds, each drawn anew, on a rig of his own."""
    return TherapyEnv(task, PATIENTS, spread=0.3, rigs=True, circuits=CIRCUITS[task])


class Learned:
    """A policy: the action as a linear function of what the last three movements came to."""

    def __init__(self, weights: np.ndarray):
        self.weights = weights.reshape(len(ACTIONS), FEATURES)
        self.recent: list[dict] = []

    def __call__(self, told: dict) -> np.ndarray:
        """Return the action after a movement; `told`: its measures, none before the first."""
        if "reached" in told:
            self.recent = [*self.recent[-2:], told]
        recent = self.recent or [{"reached": 0.5, "effort": 0.5, "pm2b": 0.0, "pm3": 0.0}]
        seen = [1.0, told["arm"].weight / 20.0]
        seen += [fmean(m["reached"] for m in recent) - 0.5]
        seen += [fmean(min(max(m["effort"], -1.0), 2.0) for m in recent) - 0.5]
        seen += [fmean(m["pm2b"] for m in recent) / 0.05]
        seen += [math.sqrt(fmean(m["pm3"] for m in recent)) / 0.02]
        share = 1.0 / (1.0 + np.exp(-self.weights @ np.array(seen)))
        return LOW + share * (HIGH - LOW)


class Shipped:
    """What a session does: the guidance of its protocol, adapted after circuits."""

    def __init__(self, env: TherapyEnv, adapts: bool = True, support: float = 0.0):
        guidance = env.protocol.guidance
        self.bounds = env.protocol.adaptation if adapts else None
        self.now = Assistance(guidance.duration, guidance.side_stiffness)
        self.support, self.sides = support, env.protocol.space != "vertical"
        self.size, self.circuits, self.movements = len(env.ways), [], []

    def __call__(self, told: dict) -> np.ndarray:
        """Return the action after a movement."""
        if "reached" in told:
            self.movements.append(told)
        if self.bounds and len(self.movements) == self.size:
            self.circuits.append(circuit_of(self.movements, self.now.side_stiffness))
            self.movements = []
            if change := adapted(self.bounds, self.now, self.circuits, self.sides):
                self.now = change.after
        share = self.support * told["arm"].weight
        return np.array([share, self.now.side_stiffness, self.now.duration])


def treated(env: TherapyEnv, policy, seed: int) -> dict:
    """Return what an episode came to: means over its movements, and whose it was."""
    _, told = env.reset(seed=seed)
    rewards, movements, over = [], [], False
    while not over:
        _, reward, ended, failed, told = env.step(policy(told))
        rewards.append(reward)
        if not failed:
            movements.append(told)
        over = ended or failed
    # Movements that a paused session did not do count as ones that were not reached.
    left = env.movements - len(movements)
    found = {"patient": told["patient"], "reward": math.fsum(rewards) / env.movements}
    for name in ("reached", "effort", "assistance"):
        values = [m[name] for m in movements]
        found[name] = fmean(values + ([0.0] * left if name == "reached" else [])) if values else 0.0
    return found


_ENV: dict[str, TherapyEnv] = {}


def _kept(task: str) -> TherapyEnv:
    return _ENV.setdefault(task, made(task))


def scored(job: tuple[str, np.ndarray, tuple[int, ...]]) -> float:
    """Return the mean reward of a policy's weights over episodes."""
    task, weights, seeds = job
    return fmean(treated(_kept(task), Learned(weights), seed)["reward"] for seed in seeds)


def judged(job: tuple[str, str, np.ndarray, int]) -> tuple[str, dict]:
    """Return the name of a policy and what an episode with it came to."""
    task, name, weights, seed = job
    env = _kept(task)
    policy = {
        "learned": lambda: Learned(weights),
        "adaptation": lambda: Shipped(env),
        "guidance, fixed": lambda: Shipped(env, adapts=False),
        "adaptation, arm carried": lambda: Shipped(env, support=1.0),
    }[name]()
    return name, treated(env, policy, seed)


def searched(task: str, pool, seed: int, rounds: int, size: int, episodes: int) -> np.ndarray:
    """Return the weights in the middle of the best of the last round."""
    draw = np.random.default_rng(seed)
    middle, spread = np.zeros(len(ACTIONS) * FEATURES), np.full(len(ACTIONS) * FEATURES, 1.5)
    for number in range(rounds):
        # The same patients for all of a round: policies differ, not luck.
        seeds = tuple(int(one) for one in draw.integers(1000, size=episodes))
        tried = middle + spread * draw.standard_normal((size, middle.size))
        rewards = np.array(list(pool.map(scored, [(task, one, seeds) for one in tried])))
        best = tried[np.argsort(rewards)[-max(size // 4, 2) :]]
        middle, spread = best.mean(axis=0), 0.9 * best.std(axis=0) + 0.1
        print(f"round {number + 1}: reward {rewards.mean():.3f}, best {rewards.max():.3f}")
    return middle


def main() -> None:
    """Learn, then judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", choices=CIRCUITS, default="height")
    parser.add_argument("--seed", type=int, default=1, help="of the search")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--size", type=int, default=8, help="policies in a round")
    parser.add_argument("--episodes", type=int, default=3, help="with each policy")
    parser.add_argument("--judged", type=int, default=20, help="episodes with each policy")
    asked = parser.parse_args()
    begun = time.perf_counter()
    with ProcessPoolExecutor(2) as pool:
        weights = searched(
            asked.task, pool, asked.seed, asked.rounds, asked.size, asked.episodes
        )
        print(f"learned in {time.perf_counter() - begun:.0f} s")
        names = ("learned", "adaptation", "guidance, fixed", "adaptation, arm carried")
        jobs = [
            (asked.task, name, weights, 10_000 + number)
            for name in names for number in range(asked.judged)
        ]  # fmt: skip
        results = list(pool.map(judged, jobs))
    columns = ("reward", "reached", "effort", "assistance")
    print(f"\njudged on {asked.judged} patients that were not used to learn\n")
    print(f"{'policy':24} {'patient':9}" + "".join(f"{name:>12}" for name in columns))
    for name in names:
        mine = [found for by, found in results if by == name]
        for patient in ("all", *PATIENTS):
            of = [one for one in mine if patient in ("all", one["patient"])]
            if of:
                means = (f"{fmean(one[column] for one in of):12.2f}" for column in columns)
                print(f"{name:24} {patient:9}" + "".join(means))
    paired = [
        mine["reward"] - theirs["reward"]
        for (_, mine), (_, theirs) in zip(
            results[: asked.judged], results[asked.judged : 2 * asked.judged], strict=True
        )
    ]
    better = sum(difference > 0.0 for difference in paired)
    print(f"\nlearned over adaptation, patient by patient: better for {better} of {len(paired)}, "
          f"median {np.median(paired):+.3f}, worst {min(paired):+.3f}")  # fmt: skip


if __name__ == "__main__":
    main()
