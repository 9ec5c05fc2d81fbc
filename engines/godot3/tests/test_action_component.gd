extends "ludus_test.gd"
## Parts of actions.


func test_a_choice() -> void:
	var part: LudusActionComponent = LudusActionComponent.discrete("push", 3)
	equal(part.to_json(), {"name": "push", "kind": "discrete", "n": 3}, "to_json")
	check(part.is_valid(), "a choice of three")
	part.n = 0
	check(not part.is_valid(), "a choice of nothing")


func test_numbers() -> void:
	var part: LudusActionComponent = LudusActionComponent.continuous("move", 2, -0.5, 1.5)
	equal(
		part.to_json(),
		{"name": "move", "kind": "continuous", "size": 2, "low": -0.5, "high": 1.5},
		"to_json"
	)
	check(part.is_valid(), "two numbers")
	part.high = -0.5
	check(not part.is_valid(), "low equals high")
	part.high = 1.0
	part.size = 0
	check(not part.is_valid(), "no numbers")


func test_defaults() -> void:
	check(LudusActionComponent.new().is_valid(), "a new component")
	equal(LudusActionComponent.continuous("x").to_json()["low"], -1.0, "low")
