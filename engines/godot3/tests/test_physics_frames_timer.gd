extends "ludus_test.gd"
## The timer of godot_gym_api's steps.

const PhysicsTimer := preload("../addons/ludus_classic/physics_frames_timer.gd")

var _num_ends: int = 0


func test_it_ends_in_the_first_frame_beyond_its_limit() -> void:
	var timer := _timer(3)
	equal(timer.start(), timer, "what start returns")
	for count in 3:
		timer.step()
		equal(_num_ends, 0, "ends after %d frames" % (count + 1))
	check(timer.is_started, "it still counts")
	timer.step()
	equal(_num_ends, 1, "ends after 4 frames")
	check(not timer.is_started, "it has stopped")


func test_it_counts_only_when_started() -> void:
	var timer := _timer(1)
	for _count in 5:
		timer.step()
	equal(_num_ends, 0, "ends before the start")
	timer.start()
	for _count in 5:
		timer.step()
	equal(_num_ends, 1, "ends after the end")


func test_a_start_begins_anew() -> void:
	var timer := _timer(2)
	timer.start()
	timer.step()
	timer.step()
	timer.start()
	timer.step()
	timer.step()
	equal(_num_ends, 0, "ends")
	timer.step()
	equal(_num_ends, 1, "ends")


func test_it_can_be_ended() -> void:
	var timer := _timer(5)
	timer.finish()
	equal(_num_ends, 0, "ends before the start")
	timer.start()
	timer.step()
	timer.finish()
	timer.finish()
	equal(_num_ends, 1, "ends")


func test_the_limit_can_be_changed() -> void:
	var timer := _timer(100)
	timer.set_limit(1)
	timer.start()
	timer.step()
	timer.step()
	equal(_num_ends, 1, "ends")


func test_the_usual_limit() -> void:
	equal(PhysicsTimer.new()._limit, 4, "limit")


func _timer(limit: int) -> PhysicsTimer:
	var timer: PhysicsTimer = PhysicsTimer.new(limit)
	check(timer.connect("timer_end", self, "_on_timer_end") == OK, "it cannot be listened to")
	return timer


func _on_timer_end() -> void:
	_num_ends += 1
