# meta-name: Ludus: a sensor
# meta-description: An entry of an agent's observation, called as the node is
# meta-default: false

@tool
extends LudusSensor3D


## How many numbers sense() returns.
func count_values() -> int:
	return 1


## Looks; each number from -1 to 1. place_of(node) is a place in the sensor's frame.
func sense() -> PackedFloat32Array:
	return PackedFloat32Array([0.0])
