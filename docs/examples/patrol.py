"""Sends an NPC around three stops, and prints when it reaches them: HTTP and JSON, nothing to install."""
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
start, *places = call("SampleGround", {"worldId": world_id, "count": 4})["points"]
npc_id = call("SpawnNpc", {"worldId": world_id, "position": start})["npcId"]
events = post("WatchEvents", {"worldId": world_id})
events.readline()  # The stream has begun: no event is missed from here on.

stops = [{"position": place, "dwellS": 1.0, "facing": 0.0} for place in places]
item = {"npcId": npc_id, "route": {"patrol": {"stops": stops}}}
for result in call("SetRoutes", {"routes": [item]})["results"]:
    assert "error" not in result, result["error"]

begun, visited = time.monotonic(), []
for line in events:
    for event in json.loads(line).get("events", []):
        if "stopReached" in event:
            visited.append(event["stopReached"].get("stop", 0))
            print(f"stop {visited[-1]} after {time.monotonic() - begun:.1f} s")
    if len(visited) >= 4:
        break
call("ClearGoals", {"npcIds": [npc_id]})
call("DropWorld", {"worldId": world_id})
