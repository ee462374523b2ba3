"""Lets an NPC walk to a goal carefully, and hurry half-way: HTTP and JSON, nothing to install."""
import json, sys, urllib.request

address = (sys.argv[1:] or ["http://127.0.0.1:7600"])[0]


def post(method, message):
    request = urllib.request.Request(f"{address}/surefoot.world.v1.WorldService/{method}", json.dumps(message).encode())
    request.add_header("Content-Type", "application/json")
    return urllib.request.urlopen(request)


def call(method, message):
    return json.load(post(method, message))


terrain = {"seed": 7, "size": {"width": 60, "depth": 60, "height": 60}}
world_id = call("CreateWorld", {"map": terrain})["world"]["worldId"]
start, goal = call("SampleGround", {"worldId": world_id, "count": 2})["points"]
npc_id = call("SpawnNpc", {"worldId": world_id, "position": start, "gait": {"name": "careful"}})["npcId"]
print("careful:", call("GetNpc", {"npcId": npc_id})["gait"])
call("SetGoal", {"npcId": npc_id, "goal": goal})


def distance(npc):
    return sum((npc["position"].get(axis, 0) - goal.get(axis, 0)) ** 2 for axis in "xyz") ** 0.5


half = None
for line in post("FollowNpc", {"npcId": npc_id, "rateHz": 10}):
    npc = json.loads(line)["npc"]
    if half is None:
        half = distance(npc) / 2
    elif half and distance(npc) < half:
        hurry = {"npcId": npc_id, "gait": {"name": "hurried", "speed": 0.8}}
        for result in call("SetGaits", {"npcs": [hurry]})["results"]:
            assert "error" not in result, result["error"]
        print("hurried:", call("GetNpc", {"npcId": npc_id})["gait"])
        half = 0
    if npc.get("attemptsEnded"):
        break
print(npc["lastOutcome"])
call("DropWorld", {"worldId": world_id})
