"""Shared by the training examples: success on unseen maps, and the curve."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

import surefoot

Floats = npt.NDArray[np.float32]
TRAINING_MAPS = list(range(8))
"""Seeds of the training maps."""
VALIDATION_MAPS = [1000, 1001, 1002, 1003]
"""Seeds of the maps on which success is measured."""
GOALS_M = (5.0, 25.0)
LONGEST = 400
"""Decisions after which an episode counts as failed."""


class Evaluation:
    """Runs one episode in each of `count` environments on unseen maps."""

    def __init__(self, folder: Path, count: int = 200) -> None:
        self.envs = surefoot.VectorEnv(
            count, VALIDATION_MAPS, goal_distance=GOALS_M, autoreset_mode=AutoresetMode.DISABLED, copy=False
        )
        self.file = folder / "curve.csv"
        self.started = time.monotonic()
        if not self.file.exists():
            self.file.write_text("decisions,updates,seconds,success,died\n")

    def success(self, act: Callable[[Floats], Floats]) -> tuple[float, float]:
        """Shares of the episodes that reached their goals, and that ended in harm; the same episodes each time."""
        observations, _ = self.envs.reset(seed=7)
        ended = np.zeros(self.envs.num_envs, np.bool_)
        reached = died = 0
        for _ in range(LONGEST):
            observations, _, terminated, truncated, infos = self.envs.step(act(observations))
            new = (terminated | truncated) & ~ended
            if infos:
                outcomes = infos["outcome"][new]
                reached += int((outcomes == "reached").sum())
                died += int(terminated[new].sum() - (outcomes == "reached").sum())
            ended |= new
            if ended.all():
                break
            if infos:
                # Environments whose episode has ended continue, but no longer count.
                self.envs.reset(options={"reset_mask": terminated | truncated})
        return reached / len(ended), died / len(ended)

    def note(self, decisions: int, updates: int, act: Callable[[Floats], Floats]) -> float:
        """Measures success, and appends it to the curve."""
        reached, died = self.success(act)
        seconds = time.monotonic() - self.started
        with self.file.open("a", newline="") as file:
            csv.writer(file).writerow([decisions, updates, f"{seconds:.1f}", f"{reached:.3f}", f"{died:.3f}"])
        print(f"{seconds:6.0f} s  {decisions:9,} decisions  {updates:7,} updates  {reached:6.1%} reached, {died:.1%} died", flush=True)
        return reached
