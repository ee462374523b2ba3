extends SceneTree
## Lets characters cross a floor, into which the game has put a pocket that is open towards them. Those whose
## rehearsals know it must push against it for less than half the time of the others. The check of this folder runs it:
##
##     godot --headless --fixed-fps 60 --path PROJECT --script tests/blocks.gd -- FLOOR.obj

const MAX_TICKS := 3600
const COUNT := 6

var _pocket: StaticBody3D
var _ends := {}


func _initialize() -> void:
	var level := OS.get_cmdline_user_args()[0]
	root.add_child(_body({Vector3(0, -0.5, 0): Vector3(60, 1, 20)}))
	var wing := Vector3(1, 6, 10)
	_pocket = _body({Vector3(0, 3, 0): Vector3(14, 1, 6), Vector3(7, 3, -5): wing, Vector3(-7, 3, -5): wing})
	# The wall at its back lies on its side.
	_pocket.get_child(0).rotation.x = PI / 2
	_pocket.rotation.y = 1.3
	root.add_child(_pocket)
	await physics_frame
	var ignorant := await _cross(level, [])
	var aware := await _cross(level, [_pocket])
	quit(0 if 2 * aware < ignorant else 1)


## A body of boxes: their sizes by their centres.
func _body(boxes: Dictionary) -> StaticBody3D:
	var body := StaticBody3D.new()
	for centre: Vector3 in boxes:
		var shape := CollisionShape3D.new()
		shape.shape = BoxShape3D.new()
		shape.shape.size = boxes[centre]
		shape.position = centre
		body.add_child(shape)
	return body


## Ticks in which characters push against the pocket.
func _cross(level: String, blocks: Array) -> int:
	# Agents of one graph learn from one another.
	var graph := SurefootGraph.new()
	graph.file = level.get_basename() + ".json"
	if not graph.align_to(level) or not graph.set_blocks(blocks):
		return MAX_TICKS
	_ends = {}
	var characters: Array[CharacterBody3D] = []
	for idx in COUNT:
		characters.append(_character(graph, Vector3(-25, 0.1, 2 * idx - 5)))
	var pushing := 0
	var ticks := 0
	while _ends.size() < COUNT and ticks < MAX_TICKS:
		await physics_frame
		ticks += 1
		for character in characters:
			pushing += 1 if not _ends.has(character) and _pushes(character) else 0
	var arrived := _ends.values().count("reached")
	var what := "the pocket is known" if blocks else "the pocket is unknown"
	print("%s: %d of %d arrived, %.1f s against it" % [what, arrived, COUNT, pushing / 60.0])
	for character in characters:
		character.free()
	return pushing


func _pushes(character: CharacterBody3D) -> bool:
	for idx in character.get_slide_collision_count():
		if character.get_slide_collision(idx).get_collider() == _pocket:
			return true
	return false


func _character(graph: SurefootGraph, start: Vector3) -> CharacterBody3D:
	var character: CharacterBody3D = load("res://character.tscn").instantiate()
	var agent: SurefootAgent3D = character.get_node("Agent")
	agent.graph = graph
	character.position = start
	root.add_child(character)
	agent.reached.connect(func() -> void: _ends[character] = "reached")
	agent.failed.connect(func(reason: String) -> void: _ends[character] = reason)
	agent.set_goal(Vector3(25, 0, start.z))
	return character
