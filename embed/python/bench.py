"""Speed of the package, compared with its own world in Rust and with other packages in the same run.

    python bench.py [SUREFOOT]    the program, such as target/release/surefoot, for the figures over loopback

Every figure is a median of rounds in which all packages take turns, on one thread each; `default` is the vector
environment with its default arguments, on all cores. Ratios are given of wall time, and of the time that the process
was running, which other work on the machine disturbs less. The latter is meaningless for a server in another process.
`gymnasium[mujoco]` and `envpool` are measured if they are installed.
"""

from __future__ import annotations

import json
import os
import platform
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

# Measures the installed package, not the sources beside this file.
sys.path = [path for path in sys.path if Path(path).resolve() != Path(__file__).parent.resolve()]

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

import surefoot
from surefoot._native import RustOnly

AGENTS = 1024
STEPS = 8
ROUNDS = 15
LEVEL = surefoot.Level.generate(0)
GOALS_M = (5.0, 25.0)
SAME: dict[str, object] = {"goal_distance": GOALS_M, "autoreset_mode": AutoresetMode.SAME_STEP}
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (AGENTS, 4)).astype(np.float32)


Times = npt.NDArray[np.float64]
"""Seconds on the wall, and of the process."""


def timed(run: Callable[[], object]) -> Times:
    started = np.array([time.perf_counter(), time.process_time()])
    run()
    return np.array([time.perf_counter(), time.process_time()]) - started


def of_vector_env(**arguments: object) -> Callable[[], Times]:
    """Seconds of some steps of a vector environment."""
    envs = surefoot.VectorEnv(AGENTS, LEVEL, **arguments)
    envs.reset(seed=1)

    def run() -> None:
        for _ in range(STEPS):
            envs.step(ACTIONS)

    return lambda: timed(run)


def of_buffers() -> Callable[[], Times]:
    env = surefoot.BufferEnv(AGENTS, LEVEL, goal_distance=GOALS_M, seed=1, threads=1)
    env.reset(seed=1)
    env.actions[:] = ACTIONS

    def run() -> None:
        for _ in range(STEPS):
            env.step()

    return lambda: timed(run)


def in_rust() -> Callable[[], Times]:
    """The same worlds with the same actions, stepped by Rust without Python."""
    alone = RustOnly(LEVEL, AGENTS, GOALS_M, 1)
    return lambda: timed(lambda: alone.seconds(ACTIONS, STEPS))


def of_gymnasium(envs: gymnasium.vector.VectorEnv, count: int) -> Callable[[], Times]:
    """Duration of this many decisions in steps of another vector environment, s."""
    envs.reset(seed=1)
    envs.action_space.seed(1)
    actions = envs.action_space.sample()
    steps = 20

    def run() -> None:
        for _ in range(steps):
            envs.step(actions)

    return lambda: timed(run) * AGENTS * STEPS / (steps * count)


def of_envpool() -> Callable[[], Times]:
    import envpool

    count = 64
    envs = envpool.make("Ant-v4", env_type="gymnasium", num_envs=count, num_threads=1, seed=1)
    envs.reset()
    actions = np.random.default_rng(0).uniform(-1, 1, (count, *envs.action_space.shape))
    steps = 20

    def run() -> None:
        for _ in range(steps):
            envs.step(actions)

    return lambda: timed(run) * AGENTS * STEPS / (steps * count)


def serve(program: str) -> tuple[subprocess.Popen[bytes], str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([program, "serve", "--listen", address], **quiet)
    while subprocess.run([program, "health", f"http://{address}"], capture_output=True).returncode != 0:
        if process.poll() is not None:
            raise SystemExit(f"{program} does not serve")
    return process, f"grpc://{address}"


def machine() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            name = next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start"


def main() -> None:
    about = machine()
    runs: dict[str, Callable[[], Times]] = {
        "rust": in_rust(),
        "vector_env": of_vector_env(**SAME, threads=1, copy=False),
        "vector_env_copy": of_vector_env(**SAME, threads=1),
        "default": of_vector_env(),
        "buffer_env": of_buffers(),
    }
    process = None
    if len(sys.argv) > 1:
        process, uri = serve(sys.argv[1])
        runs["loopback"] = of_vector_env(**SAME, server=uri, copy=False)
    missing = []
    try:
        runs["mujoco_ant"] = of_gymnasium(gymnasium.make_vec("Ant-v5", num_envs=8, vectorization_mode="sync"), 8)
    except (gymnasium.error.Error, ImportError) as error:
        missing.append(f"mujoco_ant: {error}")
    try:
        runs["envpool_ant"] = of_envpool()
    except ImportError as error:
        missing.append(f"envpool_ant: {error}")
    seconds: dict[str, list[Times]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, run in runs.items():
            seconds[name].append(run())
    if process is not None:
        process.kill()
    print(about)
    figures = []
    for name, times in seconds.items():
        # Each round has its own ratios, because other load slows all measurements of the round.
        wall, own = np.median([rust / each for rust, each in zip(seconds["rust"], times, strict=True)], axis=0)
        rates = AGENTS * STEPS / np.median(times, axis=0)
        figure: dict[str, object] = {"name": name, "decisions_s": round(rates[0]), "of_rust": round(wall, 3)}
        text = f"{name:<16}{rates[0]:>10,.0f} decisions/s {wall:>8.1%} of Rust without Python"
        if name != "loopback":
            figure |= {"decisions_cpu_s": round(rates[1]), "of_rust_cpu": round(own, 3)}
            text += f"; by its own time {rates[1]:>10,.0f} {own:>8.1%}"
        figures.append(figure)
        print(text)
    for each in missing:
        print(f"left out: {each}")
    print(json.dumps({"bench": "python", "machine": about, "agents": AGENTS, "figures": figures}))


if __name__ == "__main__":
    main()
