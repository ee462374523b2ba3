"""Soft actor-critic in one file, in the manner of CleanRL, on near goals.

    pip install ./embed/python torch
    python sac.py runs/sac

Prints the success on maps that were not trained on, writes it to RUN/curve.csv, and resumes from RUN/checkpoint.pt.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F
from evaluation import GOALS_M, TRAINING_MAPS, Evaluation, Floats
from gymnasium.vector import AutoresetMode

import surefoot


@dataclass(frozen=True)
class Config:
    """The settings, which are those of `surefoot train` where it has them (docs/training-and-models.md)."""

    env_count: int = 256
    total_decisions: int = 1_500_000
    updates_per_step: int = 4
    batch: int = 256
    buffer_steps: int = 2_000
    random_steps: int = 40
    discount: float = 0.98
    n_step: int = 3
    tau: float = 0.005
    learning_rate: float = 3e-4
    initial_alpha: float = 0.004
    target_entropy: float = -2.0
    actor_interval: int = 2
    hidden: int = 256
    evaluate_every: int = 100


class Trunk(nn.Sequential):
    """Two hidden layers."""

    def __init__(self, inputs: int, hidden: int, outputs: int) -> None:
        super().__init__(
            nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, outputs)
        )


class Actor(nn.Module):
    """A squashed Gaussian."""

    def __init__(self, observation_len: int, action_len: int, hidden: int) -> None:
        super().__init__()
        self.trunk = Trunk(observation_len, hidden, 2 * action_len)

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        mean, log_std = self.trunk(observations).chunk(2, dim=-1)
        return mean, log_std.clamp(-5.0, 2.0)

    def sample(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions, and the logarithms of their densities."""
        mean, log_std = self(observations)
        normal = torch.distributions.Normal(mean, log_std.exp())
        raw = normal.rsample()
        # log(1 - tanh(x)^2), without overflow.
        correction = 2.0 * (np.log(2.0) - raw - F.softplus(-2.0 * raw))
        return raw.tanh(), (normal.log_prob(raw) - correction).sum(-1)


class Critics(nn.Module):
    """Twin critics."""

    def __init__(self, observation_len: int, action_len: int, hidden: int) -> None:
        super().__init__()
        self.first = Trunk(observation_len + action_len, hidden, 1)
        self.second = Trunk(observation_len + action_len, hidden, 1)

    def forward(self, observations: torch.Tensor, actions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        inputs = torch.cat([observations, actions], -1)
        return self.first(inputs).squeeze(-1), self.second(inputs).squeeze(-1)


class Replay:
    """A ring of steps of all environments; draws n-step transitions, which end where an episode does."""

    def __init__(self, config: Config, observation_len: int, action_len: int) -> None:
        self.config = config
        shape = (config.buffer_steps, config.env_count)
        self.observations = np.zeros((*shape, observation_len), np.float16)
        self.next_observations = np.zeros((*shape, observation_len), np.float16)
        self.actions = np.zeros((*shape, action_len), np.float32)
        self.rewards = np.zeros(shape, np.float32)
        self.terminated = np.zeros(shape, np.bool_)
        self.ended = np.zeros(shape, np.bool_)
        self.count = 0

    def push(
        self, observations: Floats, actions: Floats, rewards: Floats, following: Floats, terminated: np.ndarray, ended: np.ndarray
    ) -> None:
        at = self.count % self.config.buffer_steps
        self.observations[at], self.actions[at], self.rewards[at] = observations, actions, rewards
        self.next_observations[at], self.terminated[at], self.ended[at] = following, terminated, ended
        self.count += 1

    def draw(self, rng: np.random.Generator) -> tuple[torch.Tensor, ...]:
        """Observations, actions, rewards of n steps, the observations after them, and their discounts."""
        config = self.config
        filled = min(self.count, config.buffer_steps)
        ages = rng.integers(config.n_step, filled, config.batch)
        steps = (self.count - 1 - ages) % config.buffer_steps
        envs = rng.integers(0, config.env_count, config.batch)
        rewards = np.zeros(config.batch, np.float32)
        weight = np.ones(config.batch, np.float32)
        runs = np.ones(config.batch, np.bool_)
        last = steps.copy()
        for step in range(config.n_step):
            at = (steps + step) % config.buffer_steps
            rewards += np.where(runs, weight * self.rewards[at, envs], 0.0)
            weight = np.where(runs, weight * config.discount, weight)
            last = np.where(runs, at, last)
            runs &= ~self.ended[at, envs]
        worth = np.where(self.terminated[last, envs], 0.0, weight)
        batch = (
            self.observations[steps, envs],
            self.actions[steps, envs],
            rewards,
            self.next_observations[last, envs],
            worth,
        )
        return tuple(torch.from_numpy(np.asarray(values, np.float32)) for values in batch)


class Learner:
    """Networks, temperature and optimisers."""

    def __init__(self, config: Config, observation_len: int, action_len: int) -> None:
        self.config = config
        sizes = (observation_len, action_len, config.hidden)
        self.actor, self.critics, self.targets = Actor(*sizes), Critics(*sizes), Critics(*sizes)
        self.targets.load_state_dict(self.critics.state_dict())
        self.log_alpha = torch.tensor(float(np.log(config.initial_alpha)), requires_grad=True)
        self.optimisers = [
            torch.optim.Adam(parameters, lr=config.learning_rate)
            for parameters in (self.actor.parameters(), self.critics.parameters(), [self.log_alpha])
        ]
        self.updates = 0

    def update(self, batch: tuple[torch.Tensor, ...]) -> None:
        """One update of the critics, and every `actor_interval` times of actor and temperature."""
        observations, actions, rewards, following, worth = batch
        for_actor, for_critics, for_alpha = self.optimisers
        alpha = self.log_alpha.exp().detach()
        with torch.no_grad():
            next_actions, log_density = self.actor.sample(following)
            value = torch.min(*self.targets(following, next_actions)) - alpha * log_density
            target = rewards + worth * value
        first, second = self.critics(observations, actions)
        loss = F.mse_loss(first, target) + F.mse_loss(second, target)
        step(for_critics, loss)
        self.updates += 1
        if self.updates % self.config.actor_interval == 0:
            chosen, log_density = self.actor.sample(observations)
            step(for_actor, (alpha * log_density - torch.min(*self.critics(observations, chosen))).mean())
            step(for_alpha, -(self.log_alpha * (log_density.detach() + self.config.target_entropy)).mean())
            with torch.no_grad():
                self.log_alpha.clamp_(min=float(np.log(1e-4)))
        with torch.no_grad():
            for target_weights, weights in zip(self.targets.parameters(), self.critics.parameters()):
                target_weights.lerp_(weights, self.config.tau)

    @torch.no_grad()
    def explore(self, observations: Floats) -> Floats:
        """Sampled actions."""
        return self.actor.sample(torch.from_numpy(observations))[0].numpy()

    @torch.no_grad()
    def act(self, observations: Floats) -> Floats:
        """The most likely actions."""
        return self.actor(torch.from_numpy(observations))[0].tanh().numpy()

    def state(self) -> dict[str, object]:
        parts = {name: getattr(self, name).state_dict() for name in ("actor", "critics", "targets")}
        optimisers = [optimiser.state_dict() for optimiser in self.optimisers]
        return {**parts, "log_alpha": self.log_alpha.item(), "optimisers": optimisers, "updates": self.updates}

    def restore(self, state: dict) -> None:
        for name in ("actor", "critics", "targets"):
            getattr(self, name).load_state_dict(state[name])
        self.log_alpha.data.fill_(state["log_alpha"])
        for optimiser, saved in zip(self.optimisers, state["optimisers"]):
            optimiser.load_state_dict(saved)
        self.updates = state["updates"]


def step(optimiser: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()


def train(folder: Path, config: Config, seed: int) -> None:
    """Trains until all decisions are made."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    envs = surefoot.VectorEnv(
        config.env_count, TRAINING_MAPS, goal_distance=GOALS_M, seed=seed, autoreset_mode=AutoresetMode.SAME_STEP, copy=False
    )
    observation_len, action_len = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    learner = Learner(config, observation_len, action_len)
    replay = Replay(config, observation_len, action_len)
    evaluation = Evaluation(folder)
    checkpoint = folder / "checkpoint.pt"
    decisions = 0
    if checkpoint.exists():
        saved = torch.load(checkpoint, weights_only=True)
        learner.restore(saved["learner"])
        decisions = saved["decisions"]
        evaluation.started = time.monotonic() - saved["seconds"]
        print(f"resumed after {decisions:,} decisions; the replay buffer begins empty")
    observations, _ = envs.reset()
    steps = 0
    while decisions < config.total_decisions:
        is_random = decisions < config.random_steps * config.env_count
        actions = rng.uniform(-1.0, 1.0, (config.env_count, action_len)).astype(np.float32) if is_random else learner.explore(observations)
        before = observations.copy()
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        following = observations
        if infos:
            following = observations.copy()
            following[infos["_final_obs"]] = np.stack(infos["final_obs"][infos["_final_obs"]])
        replay.push(before, actions, rewards, following, terminated, terminated | truncated)
        decisions += config.env_count
        steps += 1
        if steps > config.random_steps:
            for _ in range(config.updates_per_step):
                learner.update(replay.draw(rng))
        if steps % config.evaluate_every == 0 or decisions >= config.total_decisions:
            evaluation.note(decisions, learner.updates, learner.act)
            seconds = time.monotonic() - evaluation.started
            torch.save({"learner": learner.state(), "decisions": decisions, "seconds": seconds}, checkpoint)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("--decisions", type=int, default=Config.total_decisions)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    train(arguments.run, Config(total_decisions=arguments.decisions), arguments.seed)
