"""Lets an NPC go to a distant goal by plan, with the installed package."""

import sys

import surefoot
from gymnasium.vector import AutoresetMode

level = surefoot.Level.generate(7, size=100)
graph = surefoot.Graph.build(level, vertices=100)
policy = surefoot.Policy.load()
envs = surefoot.VectorEnv(1, level, goal_distance=(30, 80), autoreset_mode=AutoresetMode.DISABLED)
for seed in range(1, 9):
    envs.reset(seed=seed)
    plan = graph.plan(envs.positions()[0], envs.goals()[0])
    if not plan:
        continue
    observations = envs.redirect(0, list(plan.waypoints))[None]
    infos = {}
    while not infos:
        observations, _, _, _, infos = envs.step(policy.act(observations))
    print(f"surefoot {surefoot.__version__}, seed {seed}: {infos['outcome'][0]} along {len(plan.legs)} legs")
    if infos["outcome"][0] == "reached":
        sys.exit()
sys.exit("no NPC arrived")
