extends "policy_test.gd"
## A person plays agents by the rules of training.


class Person:
	extends "stub_agent.gd"

	func get_manual_action() -> int:
		return 1


func test_an_episode_of_one_agent_is_that_of_its_world() -> void:
	var agent: StubAgent = _people(1)[0]
	var starts := _count_starts(agent.world)
	var play := LudusManualPlay.new(tree)
	_play(play, 3)
	equal([starts.size(), agent.num_resets, agent.world.num_episodes], [1, 1, 1], "the first")
	agent.is_over = true
	_play(play, 1)
	agent.is_over = false
	equal([starts.size(), agent.num_resets, agent.world.num_episodes], [2, 2, 2], "the second")
	equal(agent.applied.size(), 3, "it acts in the same tick")
	equal(agent.episode_steps, 1, "steps")


func test_an_episode_is_cut_off() -> void:
	var people := _people(2)
	people[0].max_episode_steps = 2
	var play := LudusManualPlay.new(tree)
	_play(play, 3)
	equal([people[0].num_resets, people[1].num_resets], [1, 1], "after two steps")
	people[1].is_cut = true
	_play(play, 1)
	equal([people[0].num_resets, people[1].num_resets], [2, 2], "after the next")


func test_an_agent_begins_anew_by_itself() -> void:
	var people := _people(2)
	var starts := _count_starts(people[0].world)
	var play := LudusManualPlay.new(tree)
	_play(play, 2)
	people[0].is_over = true
	_play(play, 1)
	equal([people[0].num_resets, people[1].num_resets], [2, 1], "resets")
	equal(starts.size(), 1, "episodes of the world")


func test_agents_of_a_world_wait_for_each_other() -> void:
	var people := _people(2)
	var world: LudusWorld = people[0].world
	world.episode_mode = LudusWorld.Episode.WORLD
	var starts := _count_starts(world)
	var play := LudusManualPlay.new(tree)
	_play(play, 2)
	people[0].is_over = true
	_play(play, 3)
	equal([people[0].num_resets, people[1].num_resets], [1, 1], "the first waits")
	equal([people[0].applied.size(), people[1].applied.size()], [1, 4], "and does nothing")
	people[1].is_over = true
	_play(play, 1)
	equal([people[0].num_resets, people[1].num_resets], [2, 2], "both start another episode")
	equal([people[0].applied.size(), people[1].applied.size()], [2, 5], "and act")
	equal([starts.size(), world.num_episodes], [2, 2], "episodes of the world")


func test_newcomers_join_as_they_are() -> void:
	var first: StubAgent = _people(1)[0]
	var play := LudusManualPlay.new(tree)
	_play(play, 2)
	var newcomer: StubAgent = _people(1, first.world)[0]
	_play(play, 2)
	equal([newcomer.num_resets, newcomer.applied.size()], [0, 1], "resets and actions")
	equal(first.world.num_episodes, 1, "episodes of the world")


func test_a_person_and_a_policy_share_an_episode() -> void:
	var person: StubAgent = _people(1)[0]
	var world := person.world
	world.episode_mode = LudusWorld.Episode.WORLD
	var other: StubAgent = _in_one_world(_agents(_golden("perceptron_tanh"), 1), world)[0]
	other.ticks_per_step = 1
	var starts := _count_starts(world)
	var play := LudusManualPlay.new(tree)
	var player := _player()
	_play(play, 2, player)
	equal([starts.size(), person.num_resets, other.num_resets], [1, 1, 1], "the first")
	person.is_over = true
	_play(play, 2, player)
	equal([starts.size(), person.num_resets, other.num_resets], [1, 1, 1], "the person waits")
	other.is_over = true
	_play(play, 1, player)
	equal([starts.size(), person.num_resets, other.num_resets], [2, 2, 2], "the second")


## Agents that people play, which share a world.
func _people(count: int, world: LudusWorld = null) -> Array:
	var people := []
	for _i in count:
		var person := Person.new()
		person.action = [LudusActionComponent.discrete("jump", 2)]
		person.ticks_per_step = 1
		add(person)
		people.append(person)
	return _in_one_world(people, world)


## A list that grows with every episode of a world.
func _count_starts(world: LudusWorld) -> Array:
	var starts := []
	equal(world.connect("episode_started", self, "_note_start", [starts]), OK, "connect")
	return starts


func _note_start(starts: Array) -> void:
	starts.append(starts.size())


func _play(play: LudusManualPlay, num_ticks: int, player: LudusPolicyPlayer = null) -> void:
	for _tick in num_ticks:
		if player != null:
			player.advance()
		play.advance()
