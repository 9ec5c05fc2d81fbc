//! A game without a trainer: one world that goes on by itself, in real time.

use crate::advance::{WorldReset, begin_next, judge, observe, reset_worlds, run};
use crate::opening::{Opening, open};
use crate::schedules::Act;
use crate::stage::{Settings, Stage};
use crate::wire::{ResetAction, WorldLayout};
use bevy_ecs::prelude::*;
use serde_json::Value;
use std::time::{SystemTime, UNIX_EPOCH};

/// Marks an app that plays without a trainer.
#[derive(Resource, Debug, Default)]
pub(crate) struct Play {
    /// Of the step that runs; none before the first one.
    ticks_left: Option<u32>,
}

/// Spawns the one world and begins its first episode.
pub(crate) fn start(world: &mut World) -> Result<(), String> {
    let layout = WorldLayout::Grid;
    open(
        world,
        Opening {
            num_worlds: 1,
            first_world: 0,
            layout,
            max_episode_steps: None,
            ticks_per_step: None,
        },
    )?;
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let seed = since.map_or(0, |time| time.as_nanos() as u64);
    let reset = WorldReset {
        action: ResetAction::Seed,
        seed,
        parameters: Value::Null,
    };
    reset_worlds(world, &[reset]);
    world.resource_mut::<Stage>().is_encoding = false;
    world.insert_resource(Play::default());
    world
        .resource_mut::<Stage>()
        .error
        .take()
        .map_or(Ok(()), Err)
}

/// Runs at the beginning of every tick: every `ticks_per_step` ticks a step is over, and the game
/// decides anew in the schedule `Act`.
pub(crate) fn tick(world: &mut World) {
    let ticks = world.resource::<Settings>().ticks_per_step;
    let mut play = world.resource_mut::<Play>();
    let has_stepped = play.ticks_left == Some(0);
    let left = play.ticks_left.filter(|left| *left > 0);
    play.ticks_left = Some(left.unwrap_or(ticks) - 1);
    if has_stepped {
        judge(world);
        observe(world);
        begin_next(world);
    }
    if left.is_none() {
        run(world, Act);
    }
}
