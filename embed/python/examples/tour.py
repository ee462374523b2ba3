"""A tour of the package: environments, graphs and plans, policies, a server, and recorded episodes.

    pip install "./embed/python[pettingzoo,graphs,datasets]"
    python tour.py

SUREFOOT names the program; without it, the parts that need a server are left out.
"""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

import surefoot
from surefoot import datasets

LEVEL = surefoot.Level.generate(7, size=100, features={"lava": 0.5, "pads": 2.0})


def step_many() -> None:
    """A vector environment, whose actions a shipped policy chooses."""
    envs = surefoot.VectorEnv(64, LEVEL, goal_distance=(5, 25), autoreset_mode=AutoresetMode.SAME_STEP)
    policy = surefoot.Policy.load("general-lstm")
    observations, _ = envs.reset(seed=1)
    begun = np.ones(64, np.bool_)
    outcomes: list[str] = []
    for _ in range(100):
        observations, rewards, terminated, truncated, infos = envs.step(policy.act(observations, reset=begun))
        begun = terminated | truncated
        if infos:
            outcomes += list(infos["final_info"]["outcome"][begun])
    print(f"{envs}: {outcomes.count('reached')} of {len(outcomes)} reached, last rewards {rewards.mean():.4f}")


def step_one() -> None:
    """One environment, as gymnasium.make makes it."""
    env = gymnasium.make("surefoot/PointGoal-v0", level=LEVEL, body="climber", render_mode="rgb_array")
    env.action_space.seed(1)
    observation, _ = env.reset(seed=1)
    length = 0
    while True:
        observation, _, terminated, truncated, info = env.step(env.action_space.sample())
        length += 1
        if terminated or truncated:
            break
    picture = np.asarray(env.render())
    print(f"{env}: {info['outcome']} after {length} decisions, {observation.shape[0]} values, a picture {picture.shape}")


def step_agents() -> None:
    """Agents that share a world."""
    env = surefoot.ParallelEnv(6, LEVEL, goal_distance=(5, 15))
    policy = surefoot.Policy.load()
    observations, _ = env.reset(seed=1)
    outcomes: dict[str, str] = {}
    while env.agents:
        actions = policy.act(np.stack([observations[agent] for agent in env.agents]))
        observations, _, _, _, infos = env.step(dict(zip(env.agents, actions, strict=True)))
        outcomes |= {agent: info["outcome"] for agent, info in infos.items() if info}
    print(f"{type(env).__name__}: {outcomes}")


def step_buffers() -> None:
    """Environments that write into our arrays."""
    buffers = {
        "observations": np.zeros((32, 369), np.float32),
        "actions": np.zeros((32, 4), np.float32),
        "rewards": np.zeros(32, np.float32),
        "terminals": np.zeros(32, np.bool_),
        "truncations": np.zeros(32, np.bool_),
    }
    env = surefoot.BufferEnv(32, LEVEL, buf=buffers)
    env.reset(seed=1)
    buffers["actions"][:, 0] = 1.0
    for _ in range(50):
        env.step()
    print(f"{type(env).__name__}: {int(buffers['terminals'].sum())} ended in the last step")


def follow_a_plan() -> None:
    """A distant goal with a plan."""
    graph = surefoot.Graph.build(LEVEL, vertices=100)
    envs = surefoot.VectorEnv(1, LEVEL, goal_distance=(60, 120), autoreset_mode=AutoresetMode.DISABLED)
    observations, _ = envs.reset(seed=3)
    plan = graph.plan(envs.positions()[0], envs.goals()[0], caution=1.0)
    print(f"{graph}: {plan}, {[leg.ability for leg in plan.legs]}")
    observations = envs.redirect(0, list(plan.waypoints))[None]
    policy = surefoot.Policy.load()
    for decisions in range(1, 401):
        observations, _, terminated, truncated, infos = envs.step(policy.act(observations))
        if infos:
            print(f"  {infos['outcome'][0]} after {decisions} decisions")
            break
    directed = graph.to_networkx()
    print(f"  as networkx: {directed.number_of_nodes()} nodes; connected: {graph.reach()['connected']:.0%}")
    picture = graph.png(pixels_per_m=4.0)
    print(f"  a picture of {len(picture)} bytes")


def keep_episodes(folder: Path) -> None:
    """Episodes as Parquet files."""
    envs = surefoot.VectorEnv(8, LEVEL, autoreset_mode=AutoresetMode.SAME_STEP)
    policy = surefoot.Policy.load()
    episodes = datasets.record(envs, lambda observations, begun: policy.act(observations, reset=begun), 20, seed=1)
    datasets.save_parquet(episodes, folder / "episodes")
    read = datasets.load_parquet(folder / "episodes")
    print(f"{len(read)} episodes of {np.mean([len(episode) for episode in read]):.1f} decisions")


def step_remotely(program: str) -> None:
    """The same environments on a server."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    process = subprocess.Popen([program, "serve", "--listen", address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while subprocess.run([program, "health", f"http://{address}"], capture_output=True).returncode != 0:
            assert process.poll() is None, "the server ended"
        server = surefoot.connect(f"grpc://{address}", patience=10.0)
        here, there = (surefoot.VectorEnv(8, LEVEL, server=it) for it in (None, server))
        mine, theirs = (envs.reset(seed=1)[0] for envs in (here, there))
        print(f"{server}: the same bits as here: {np.array_equal(mine, theirs)}")
    finally:
        process.kill()


def main() -> None:
    """Runs all parts."""
    print(LEVEL, surefoot.body_names())
    step_many()
    step_one()
    step_agents()
    step_buffers()
    follow_a_plan()
    with tempfile.TemporaryDirectory() as folder:
        keep_episodes(Path(folder))
    program = os.environ.get("SUREFOOT")
    if program:
        step_remotely(program)


if __name__ == "__main__":
    main()
