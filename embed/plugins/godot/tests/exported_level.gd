extends RefCounted
## Makes a level that one can run about on from a .glb that `surefoot map export` wrote, while the game runs. For levels of your own, the editor's
## import does that.

const LEVEL_LAYER := 1
const SEEN_LAYER := 4
const GRAVITY := 20.0


## The level as a node; null, and an error in the log, if the file cannot be read.
static func build(file: String) -> Node3D:
	var document := GLTFDocument.new()
	var state := GLTFState.new()
	if document.append_from_file(file, state) != OK:
		push_error("'%s' is not a level" % file)
		return null
	var level := Node3D.new()
	var scene := document.generate_scene(state)
	for mesh: MeshInstance3D in scene.find_children("*", "MeshInstance3D", true, false):
		level.add_child(_body_of(mesh))
	scene.free()
	return level


## A node's triangles as something solid, or as something that is only seen.
static func _body_of(mesh: MeshInstance3D) -> Node3D:
	var kind := mesh.name.to_lower().get_slice("_", 0)
	if kind == "pad":
		var pad: Area3D = load("res://jump_pad.tscn").instantiate()
		pad.position = mesh.position
		pad.height = mesh.get_meta("extras")["height"]
		return pad
	var shape := CollisionShape3D.new()
	shape.shape = ConcavePolygonShape3D.new()
	shape.shape.set_faces(mesh.transform * mesh.mesh.get_faces())
	var body := StaticBody3D.new()
	body.collision_layer = SEEN_LAYER if kind in ["water", "lava"] else LEVEL_LAYER
	body.add_to_group("surefoot_" + kind)
	body.add_child(shape)
	return body
