extends Area3D
## Throws whatever stands on it. Its group, `surefoot_pad`, lets agents see it.

## Gravity of characters, m/s2.
const GRAVITY := 20.0

## How high it throws beyond 10 m, m: what importers of levels read as `height` in the node's extras.
@export var height := 0.0


func _physics_process(_delta: float) -> void:
	for body in get_overlapping_bodies():
		if body is CharacterBody3D and body.velocity.y <= 0.0:
			body.velocity.y = sqrt(2.0 * GRAVITY * (height + 10.0))
			for agent in body.find_children("*", "SurefootAgent3D"):
				agent.note_ability("pad")
