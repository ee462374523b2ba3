extends SceneTree
## Writes a scene as glTF, as `Scene > Export As > glTF 2.0 Scene` of the editor does:
##
##     godot --headless --path PROJECT --script export_level.gd -- res://boxes.tscn res://level.glb


func _initialize() -> void:
	var paths := OS.get_cmdline_user_args()
	if paths.size() != 2:
		push_error("export_level.gd takes a scene and the file to write")
		quit(1)
		return
	var scene: Node = load(paths[0]).instantiate()
	root.add_child(scene)
	# Shapes made of solids have their meshes after a frame.
	await process_frame
	await process_frame
	var document := GLTFDocument.new()
	var state := GLTFState.new()
	var error := document.append_from_scene(scene, state)
	if error == OK:
		error = document.write_to_filesystem(state, paths[1])
	quit(0 if error == OK else 1)
