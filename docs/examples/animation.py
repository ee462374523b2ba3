"""Follows an NPC as an animation does: prints its pace, its leaps and where it will be. HTTP and JSON, nothing to install."""
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
npc_id = call("SpawnNpc", {"worldId": world_id, "position": start})["npcId"]
call("SetGoal", {"npcId": npc_id, "goal": goal})

shown, predictions = None, 0
for line in post("FollowNpc", {"npcId": npc_id, "rateHz": 20}):
    npc = json.loads(line)["npc"]
    movement = npc["movement"]
    state = movement["pace"], movement.get("phase", "")
    if state != shown:
        print(*state, f"stride {movement.get('strideM', 0):.1f} m")
        shown = state
    pose = movement.get("prediction", {}).get("in60Ticks")
    predictions += pose is not None
    if npc.get("attemptsEnded"):
        break
print(f"{npc['lastOutcome']}, {predictions} messages with a pose of the next second")
call("DropWorld", {"worldId": world_id})
