"""Soft actor-critic of Stable-Baselines3 on near goals.

    pip install "./embed/python[sb3]"
    python sb3_sac.py runs/sb3

Prints the success on maps that were not trained on, writes it to RUN/curve.csv and the policy to RUN/policy.zip.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from evaluation import GOALS_M, TRAINING_MAPS, Evaluation, Floats
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

from surefoot.sb3 import SB3VecEnv

ENV_COUNT = 256
EVALUATE_EVERY = 100


class Success(BaseCallback):
    """Measures success, and saves the policy."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.evaluation = Evaluation(folder)

    def act(self, observations: Floats) -> Floats:
        """The most likely actions."""
        return self.model.predict(observations, deterministic=True)[0]

    def _on_step(self) -> bool:
        if self.n_calls % EVALUATE_EVERY == 0:
            self.evaluation.note(self.num_timesteps, self.model._n_updates, self.act)
            self.model.save(self.folder / "policy.zip")
        return True


def train(folder: Path, decisions: int, seed: int) -> None:
    """Trains until all decisions are made."""
    torch.set_num_threads(1)
    folder.mkdir(parents=True, exist_ok=True)
    envs = SB3VecEnv(ENV_COUNT, TRAINING_MAPS, goal_distance=GOALS_M, seed=seed)
    model = SAC(
        "MlpPolicy",
        envs,
        learning_starts=10_000,
        buffer_size=300_000,
        batch_size=256,
        train_freq=1,
        gradient_steps=4,
        gamma=0.98,
        n_steps=3,
        # Entropy counts as reward: a high temperature favours survival over arrival.
        ent_coef="auto_0.004",
        target_entropy=-2.0,
        policy_kwargs={"net_arch": [256, 256]},
        seed=seed,
    )
    model.learn(decisions, callback=Success(folder), log_interval=None)
    model.save(folder / "policy.zip")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("--decisions", type=int, default=600_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    train(arguments.run, arguments.decisions, arguments.seed)
