"""Times PyTorch and onnxruntime on what `surefoot bench learn` times, and prints ratios.

    pip install torch onnxruntime onnx numpy
    python learn/train/benches/peers.py target/release/surefoot

The networks, batch shapes and losses are those of learn/train/src/sac.rs with its defaults: separate encoders for actor and
twin critics, an actor update at every second critic update, no gradients for the critics' weights in the actor's loss,
Polyak averaging. Everything is run in one go, so that a noisy machine is noisy for all. Ratios above 1: surefoot is faster.
It also holds the exported ONNX models against surefoot's own decisions on 1,000 observations.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import onnxruntime as ort
import torch
import torch.nn.functional as F
from torch import nn

RAYS, STATE, ACTIONS = 320, 49, 4
OBSERVATION = RAYS + STATE
RAY_FEATURES, HIDDEN = 128, 256


class Trunk(nn.Module):
    def __init__(self, extra, memory):
        super().__init__()
        sensed = RAY_FEATURES + STATE
        self.rays = nn.Linear(RAYS, RAY_FEATURES)
        self.memory = nn.LSTM(sensed, memory) if memory else None
        self.first = nn.Linear(sensed + memory + extra, HIDDEN)
        self.second = nn.Linear(HIDDEN, HIDDEN)

    def encode(self, x, past=None):
        sensed = torch.cat([F.relu(self.rays(x[..., :RAYS])), x[..., RAYS:]], -1)
        if self.memory is None:
            return sensed, None
        remembered, past = self.memory(sensed, past)
        return torch.cat([sensed, remembered], -1), past

    def consider(self, *inputs):
        return F.relu(self.second(F.relu(self.first(torch.cat(inputs, -1)))))


class Actor(nn.Module):
    def __init__(self, memory):
        super().__init__()
        self.trunk, self.head = Trunk(0, memory), nn.Linear(HIDDEN, 2 * ACTIONS)

    def sample(self, x, past=None):
        encoding, past = self.trunk.encode(x, past)
        mean, log_std = self.head(self.trunk.consider(encoding)).chunk(2, -1)
        log_std = log_std.clamp(-5, 2)
        noise = torch.randn_like(mean)
        raw = mean + log_std.exp() * noise
        log_prob = -0.5 * noise**2 - log_std - 0.918938 - 2 * (0.693147 - raw - F.softplus(-2 * raw))
        return raw.tanh(), log_prob.sum(-1, keepdim=True), past


class Critic(nn.Module):
    def __init__(self, memory):
        super().__init__()
        self.trunk, self.head = Trunk(ACTIONS, memory), nn.Linear(HIDDEN, 1)

    def forward(self, encoding, action):
        return self.head(self.trunk.consider(encoding, action))


class Learner:
    def __init__(self, memory):
        self.memory = memory
        self.actor = Actor(memory)
        self.critics = nn.ModuleList([Critic(memory) for _ in range(2)])
        self.targets = nn.ModuleList([Critic(memory) for _ in range(2)])
        self.log_alpha = torch.tensor(-3.0, requires_grad=True)
        adam = lambda parameters: torch.optim.Adam(parameters, lr=3e-4)
        self.actor_adam, self.critic_adam = adam(self.actor.parameters()), adam(self.critics.parameters())
        self.alpha_adam = adam([self.log_alpha])
        self.updates = 0

    def step(self, x, actions, returns, burn_in, learn, lookahead):
        alpha = self.log_alpha.exp().detach()
        with torch.no_grad():
            if self.memory:
                # Every step passes the memories; the successors of the learned steps are picked.
                chosen = slice(burn_in + lookahead, burn_in + lookahead + learn)
                action, log_prob, _ = self.actor.sample(x)
                encodings = [target.trunk.encode(x)[0][chosen] for target in self.targets]
                action, log_prob = action[chosen], log_prob[chosen]
            else:
                action, log_prob, _ = self.actor.sample(x[1])
                encodings = [target.trunk.encode(x[1])[0] for target in self.targets]
            value = torch.min(*[target(e, action) for target, e in zip(self.targets, encodings)])
            goal = returns + 0.98 * (value - alpha * log_prob)
            pasts = [None, None]
            if burn_in:
                pasts = [critic.trunk.encode(x[:burn_in])[1] for critic in self.critics]
        learned = x[burn_in : burn_in + learn] if self.memory else x[0]
        encodings = [critic.trunk.encode(learned, past)[0] for critic, past in zip(self.critics, pasts)]
        loss = sum(((critic(e, actions) - goal) ** 2).mean() for critic, e in zip(self.critics, encodings))
        self.critic_adam.zero_grad(set_to_none=True)
        loss.backward()
        if self.updates % 2 == 0:
            with torch.no_grad():
                past = self.actor.trunk.encode(x[:burn_in])[1] if burn_in else None
            action, log_prob, _ = self.actor.sample(learned, past)
            for parameter in self.critics.parameters():
                parameter.requires_grad_(False)
            value = torch.min(*[critic(e.detach(), action) for critic, e in zip(self.critics, encodings)])
            loss = (alpha * log_prob - value).mean()
            self.actor_adam.zero_grad(set_to_none=True)
            loss.backward()
            for parameter in self.critics.parameters():
                parameter.requires_grad_(True)
            self.actor_adam.step()
            self.alpha_adam.zero_grad(set_to_none=True)
            (self.log_alpha * -(log_prob.detach().mean() - 2.0)).backward()
            self.alpha_adam.step()
        self.critic_adam.step()
        with torch.no_grad():
            torch._foreach_lerp_(list(self.targets.parameters()), list(self.critics.parameters()), 0.005)
        self.updates += 1


def updates_per_second(memory, batch, burn_in, learn, lookahead, count):
    learner = Learner(memory)
    steps = burn_in + learn + lookahead if memory else 2
    x = torch.rand(steps, batch, OBSERVATION) * 2 - 1
    shape = (learn, batch) if memory else (batch,)
    actions, returns = torch.rand(*shape, ACTIONS) * 2 - 1, torch.rand(*shape, 1)
    times = []
    for _ in range(count):
        start = time.perf_counter()
        for _ in range(2):
            learner.step(x, actions, returns, burn_in, learn, lookahead)
        times.append(time.perf_counter() - start)
    return 2.0 / statistics.median(times[2:])


def inference_us(path, rows, threads, memory):
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    session = ort.InferenceSession(path, options)
    feed = {"observations": np.random.rand(rows, OBSERVATION).astype("f4")}
    if memory:
        feed |= {name: np.zeros((rows, memory), "f4") for name in ("hidden_in", "cell_in")}
    times = []
    for _ in range(200):
        start = time.perf_counter()
        session.run(["action"], feed)
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e6


def parity(surefoot, model, path):
    """Largest difference between onnxruntime and surefoot over 1,000 observations in 10 steps of memory."""
    checked = json.loads(subprocess.check_output([surefoot, "export", "--check", "1000", *model, "--json"]))
    session = ort.InferenceSession(path)
    memory = {i.name: np.zeros((checked["rows"], i.shape[1]), "f4") for i in session.get_inputs()[1:]}
    worst = 0.0
    for step in checked["steps"]:
        feed = {"observations": np.array(step["observations"], "f4").reshape(checked["rows"], -1), **memory}
        names = [output.name for output in session.get_outputs()]
        out = dict(zip(names, session.run(names, feed)))
        memory = {name.replace("out", "in"): value for name, value in out.items() if name.endswith("_out")}
        worst = max(worst, float(np.abs(out["action"] - np.array(step["actions"]).reshape(-1, ACTIONS)).max()))
    return worst


def main():
    surefoot = sys.argv[1] if len(sys.argv) > 1 else "target/release/surefoot"
    bench = json.loads(subprocess.check_output([surefoot, "bench", "learn", "--json"]))
    ours = {figure["name"]: figure["value"] for figure in bench["figures"]}
    print(f"machine: {bench['machine']}")
    line = "{:<34}{:>12}{:>12}{:>10}"
    print(line.format("figure", "surefoot", "peer", "ratio"))

    def show(name, mine, theirs, higher_is_better):
        ratio = mine / theirs if higher_is_better else theirs / mine
        print(line.format(name, f"{mine:.1f}", f"{theirs:.1f}", f"x{ratio:.2f}"))

    for threads in (1, 2):
        torch.set_num_threads(threads)
        show(f"SAC updates/s, torch {threads} thread(s)", ours["sac_updates_s"], updates_per_second(0, 256, 0, 1, 1, 40), True)
        theirs = updates_per_second(64, 32, 20, 20, 3, 12)
        show(f"LSTM updates/s, torch {threads} thread(s)", ours["sac_recurrent_updates_s"], theirs, True)
    for model, memory in (([], 0), (["--model", "models/general-lstm"], 64)):
        kind = "LSTM" if memory else "reactive"
        with tempfile.NamedTemporaryFile(suffix=".onnx") as file:
            if subprocess.call([surefoot, "export", *model, "--onnx", file.name], stderr=subprocess.DEVNULL):
                print(f"no {kind} model")
                continue
            for rows in (64, 256, 512):
                for threads in (1, 2):
                    name = f"{kind} {rows} rows us, ort {threads} thread(s)"
                    mine = ours.get(f"infer_{'lstm_' if memory else ''}{rows}_us")
                    show(name, mine, inference_us(file.name, rows, threads, memory), False)
            print(f"{kind}: largest difference to onnxruntime {parity(surefoot, model, file.name):.2e}")


main()
