"""Lets an NPC keep to a player that walks away from it: HTTP and JSON, nothing to install."""
import json, sys, time, urllib.request

address = (sys.argv[1:] or ["http://127.0.0.1:7600"])[0]


def post(method, message):
    request = urllib.request.Request(f"{address}/surefoot.world.v1.WorldService/{method}", json.dumps(message).encode())
    request.add_header("Content-Type", "application/json")
    return urllib.request.urlopen(request)


def call(method, message):
    return json.load(post(method, message))


terrain = {"seed": 7, "size": {"width": 60, "depth": 60, "height": 60}}
world_id = call("CreateWorld", {"map": terrain})["world"]["worldId"]
start, first, second = call("SampleGround", {"worldId": world_id, "count": 3})["points"]
npc_id = call("SpawnNpc", {"worldId": world_id, "position": start})["npcId"]
events = post("WatchEvents", {"worldId": world_id})
events.readline()  # The stream has begun: no event is missed from here on.

player_id = call("SpawnPlayer", {"worldId": world_id, "position": first}).get("playerId", 0)
call("SetGoal", {"npcId": npc_id, "targetPlayerId": player_id, "radius": 2.0, "keep": True})

begun, times = time.monotonic(), []
for line in events:
    for event in json.loads(line).get("events", []):
        if "targetReached" in event:
            times.append(time.monotonic() - begun)
            call("MovePlayers", {"worldId": world_id, "moves": [{"playerId": player_id, "position": second}]})
    if len(times) == 2:
        break
call("ClearGoals", {"npcIds": [npc_id]})
print(f"beside the player after {times[0]:.1f} s, and again after {times[1] - times[0]:.1f} s")
call("DropWorld", {"worldId": world_id})
