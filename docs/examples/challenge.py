"""Attempts the goals of a set with a simple agent, and writes its actions as a run: HTTP and JSON, nothing to install.

    python3 challenge.py http://127.0.0.1:7600 sets/paper-like run.json

Replace `Agent` by your own: it gets an observation of 369 numbers (docs/reference/observations.md) and answers with forward, strafe, turn
and jump, each -1 to 1. `surefoot challenge score run.json` does the actions again and counts who arrives.
"""
import array, base64, json, math, sys, time, urllib.request

DECISIONS = 600  # 100 s.
RAYS, STATE = 64, 320  # Proximities of 8 rows of 8 rays come first; the state vector follows the five channels.


class Agent:
    """Turns towards the goal, runs, keeps away from lava and from edges above nothing, and jumps when it gets nowhere."""

    def __init__(self):
        self.stuck, self.side = 0, 1.0

    def act(self, seen):
        goal_x, goal_y, goal_z = seen[STATE + 1 : STATE + 4]
        speed = 12.0 * math.hypot(seen[STATE + 6], seen[STATE + 8])
        grounded, can_jump = seen[STATE + 16] > 0.5, seen[STATE + 17] > 0.5
        self.stuck = self.stuck + 1 if speed < 2.0 else 0
        # Rows 0 to 3 look down; columns 3 and 4 look ahead.
        ahead = [8 * row + column for row in range(4) for column in (3, 4)]
        lava = any(seen[2 * RAYS + ray] > 0.5 and seen[ray] > 0.5 for ray in ahead)
        void = grounded and goal_y > -0.3 and all(seen[ray] == 0.0 for ray in ahead[2:])
        turn = max(-1.0, min(1.0, -math.atan2(goal_x, goal_z)))
        if self.stuck > 12:
            self.stuck, self.side = 0, -self.side
        if self.stuck > 6 or lava or void:
            return [0.4, -self.side, 0.7 * self.side, 1.0 if can_jump and not lava else -1.0]
        jump = can_jump and (self.stuck > 2 or (grounded and goal_y > 0.25) or (not grounded and goal_y > 0.0))
        return [1.0 if abs(turn) < 0.9 else 0.2, 0.0, turn, 1.0 if jump else -1.0]


def call(server, method, message):
    request = urllib.request.Request(f"{server}/surefoot.world.v1.EnvService/{method}", json.dumps(message).encode())
    request.add_header("Content-Type", "application/json")
    return json.load(urllib.request.urlopen(request))


def floats(text):
    values = array.array("f", base64.b64decode(text))
    if sys.byteorder == "big":
        values.byteswap()
    return values


def place(at):
    return dict(zip("xyz", at))


def attempt(server, body, of_set):
    """The actions of one agent for each goal of a map, until its episode ends."""
    spec = of_set["spec"]
    goals = [{"start": place(it["start"]), "yaw": it["yaw"], "goal": place(it["goal"])} for it in of_set["goals"]]
    spec = {**spec, "kind": f"MAP_KIND_{spec['kind'].upper()}"}
    created = call(server, "CreateEnv", {"map": spec, "body": body, "goals": goals})
    env, width, seen = created["envId"], created["observationLen"], floats(created["observations"])
    agents, actions, running = [Agent() for _ in goals], [[] for _ in goals], set(range(len(goals)))
    for _ in range(DECISIONS):
        packed = array.array("f", bytes(16 * len(goals)))
        for npc in running:
            action = agents[npc].act(seen[npc * width : (npc + 1) * width])
            packed[4 * npc : 4 * npc + 4] = array.array("f", action)
            actions[npc].append(list(packed[4 * npc : 4 * npc + 4]))
        message = {"envId": env, "actions": {"actions": base64.b64encode(packed.tobytes()).decode()}}
        results = call(server, "StepEnv", message)["results"]
        seen = floats(results["observations"])
        running -= {end.get("npc", 0) for end in results.get("ends", [])}
        if not running:
            break
    call(server, "CloseEnv", {"envId": env})
    return [{"actions": done} for done in actions]


def main(server, folder, out):
    with open(f"{folder}/set.json") as file:
        goal_set = json.load(file)
    maps = []
    for of_set in goal_set["maps"]:
        started = time.time()
        maps.append({"name": of_set["name"], "attempts": attempt(server, goal_set["body"], of_set)})
        print(f"{of_set['name']}: {len(of_set['goals'])} attempts in {time.time() - started:.0f} s", file=sys.stderr)
    run = {"challenge": goal_set["challenge"], "set": goal_set["set"], "entrant": "Simple agent", "maps": maps}
    run["about"] = "docs/examples/challenge.py"
    with open(out, "w") as file:
        json.dump(run, file)


if len(sys.argv) != 4:
    sys.exit(f"usage: {sys.argv[0]} ADDRESS SET RUN, such as http://127.0.0.1:7600 sets/part run.json")
main(*sys.argv[1:])
