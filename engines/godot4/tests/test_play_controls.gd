extends "ludus_test.gd"
## Keys of people who watch: pause, single steps, slow motion.

const LudusPlayControls := preload("res://addons/ludus/bridge/play_controls.gd")


func test_keys_hold_time() -> void:
	var controls := LudusPlayControls.new()
	controls.ticks_per_step = 3
	add(controls)
	equal(_passes(controls, 4), 4, "at first all ticks pass")
	_tap(LudusPlayControls.PAUSE_KEY)
	equal(_passes(controls, 4), 0, "paused")
	check(tree.paused, "the tree is paused")
	_tap(LudusPlayControls.STEP_KEY)
	equal(_passes(controls, 10), 3, "one step")
	check(tree.paused, "and paused again")
	_tap(LudusPlayControls.PAUSE_KEY)
	equal(_passes(controls, 2), 2, "it goes on")
	check(not tree.paused, "the tree runs")
	_tap(LudusPlayControls.SLOWER_KEY)
	equal(_passes(controls, 12), 6, "half")
	_tap(LudusPlayControls.SLOWER_KEY)
	equal(_passes(controls, 12), 3, "a quarter")
	for i: int in 2:
		_tap(LudusPlayControls.SLOWER_KEY)
	equal(_passes(controls, 5), 5, "and back")
	check(not tree.paused, "the tree runs at last")
	controls.free()


func _passes(controls: LudusPlayControls, num_frames: int) -> int:
	var count := 0
	for i: int in num_frames:
		count += int(controls.lets_pass())
	return count


func _tap(key: Key) -> void:
	press(key, true)
	press(key, false)
