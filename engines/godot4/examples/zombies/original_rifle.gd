extends RefCounted
## The soldier's rifle by the original's rules: who shoots with an empty magazine reloads, and what
## was left in a magazine is lost.
##
## Its numbers are added up as the original does: rounding makes 19 shots of 20, and 11 steps of 10.

const MAGAZINE := 0.2
const SHOT := 0.01
const FIRE_DELAY := 0.02
const RELOAD_DELAY := 0.1
## What a step takes of both delays.
const STEP := 0.01

var ammunition: float = MAGAZINE
var fire_delay: float = 0.0
var reload_delay: float = 0.0


## Lets a step pass.
func wait() -> void:
	var was_reloading := reload_delay > 0.0
	reload_delay = maxf(reload_delay - STEP, 0.0)
	fire_delay = maxf(fire_delay - STEP, 0.0)
	if was_reloading and reload_delay == 0.0:
		ammunition = MAGAZINE


## Shoots if it can; returns whether it did.
func shoot() -> bool:
	if ammunition < SHOT:
		reload()
		return false
	if fire_delay > 0.0:
		return false
	ammunition -= SHOT
	fire_delay = FIRE_DELAY
	return true


## Begins to reload, unless it does already or the magazine is full.
func reload() -> void:
	if ammunition < MAGAZINE and reload_delay == 0.0:
		ammunition = 0.0
		reload_delay = RELOAD_DELAY


## What a soldier senses of it, from 0 to 1.
func numbers() -> PackedFloat32Array:
	return [ammunition, MAGAZINE, reload_delay, RELOAD_DELAY, FIRE_DELAY, fire_delay]
