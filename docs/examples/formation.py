"""Sends five NPCs to one place as a wedge, and prints how it ends for each: HTTP and JSON, nothing to install."""
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
*starts, goal = call("SampleGround", {"worldId": world_id, "count": 6})["points"]
spawned = call("BatchSpawnNpcs", {"worldId": world_id, "spawns": [{"position": start} for start in starts]})
leader, *followers = [result["npcId"] for result in spawned["results"]]
events = post("WatchEvents", {"worldId": world_id})
events.readline()  # The stream has begun: no event is missed from here on.

order = {"leader": {"npcId": leader, "goal": goal}, "followerIds": followers, "formation": "FORMATION_WEDGE"}
for result in call("SetGroupGoal", order)["followers"]:
    assert "error" not in result, result["error"]

ends = {}
for line in events:
    for event in json.loads(line).get("events", []):
        if "attemptEnded" in event:
            ends[event["npcId"]] = event["attemptEnded"]["outcome"]
    if len(ends) == 5:
        break
print("leader:", ends.pop(leader), "followers:", *ends.values())
call("DropWorld", {"worldId": world_id})
