//! A game without a trainer: one world that goes on by itself, played by trained policies, by the
//! game or by people; in real time, or without a window as fast as it can.

use crate::advance::{WorldReset, begin_next, judge, observe, reset_worlds, run};
use crate::error::{GameError, end_with_error};
use crate::opening::{Opening, open};
use crate::policy_player::PolicyPlayer;
use crate::policy_plugin::PolicySources;
use crate::schedules::Act;
use crate::stage::{Settings, Stage};
use crate::systems::ReadActions;
use crate::wire::{ResetAction, WorldLayout};
use bevy_app::AppExit;
use bevy_ecs::prelude::*;
use bevy_time::{Time, TimeUpdateStrategy, Virtual};
use serde_json::Value;
use std::time::Duration;
use web_time::{SystemTime, UNIX_EPOCH};

/// Marks an app that plays without a trainer.
#[derive(Resource, Debug, Default)]
pub(crate) struct Play {
    /// Of the step that runs; none before the first one.
    ticks_left: Option<u32>,
    player: PolicyPlayer,
    /// Which slots of a policy act, while the others read their actions.
    kept_active: Vec<Vec<u8>>,
}

/// Plays with the policies that the app brings along; what goes wrong is printed and ends it.
#[cfg(not(feature = "trainer"))]
pub(crate) fn start_alone(world: &mut World) {
    let sources = world.remove_resource::<PolicySources>().unwrap_or_default();
    if let Err(error) = start(world, &sources) {
        end_with_error(world, &error, error.hint());
    }
}

/// Spawns the one world and begins its first episode.
pub(crate) fn start(world: &mut World, sources: &PolicySources) -> Result<(), GameError> {
    #[cfg(feature = "camera")]
    crate::camera::check_renderer(world)?;
    let opening = Opening {
        num_worlds: 1,
        first_world: 0,
        layout: WorldLayout::Grid,
        max_episode_steps: None,
        ticks_per_step: None,
    };
    open(world, opening)?;
    let seed = sources.seed.unwrap_or_else(seed_of_clock);
    let stage = world.resource::<Stage>();
    let player = PolicyPlayer::open(&stage.spec, sources, seed)?;
    let kept_active = stage
        .rosters
        .iter()
        .map(|roster| roster.active.clone())
        .collect();
    let reset = WorldReset {
        action: ResetAction::Seed,
        seed,
        parameters: Value::Null,
    };
    reset_worlds(world, &[reset]);
    let mut stage = world.resource_mut::<Stage>();
    stage.is_encoding = !player.is_idle();
    let error = stage.error.take();
    world.insert_resource(Play {
        ticks_left: None,
        player,
        kept_active,
    });
    if sources.is_uncapped {
        run_uncapped(world);
    }
    error.map_or(Ok(()), Err)
}

fn seed_of_clock() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |time| time.as_nanos() as u64)
}

/// Lets every update of the app be a step, whatever the clock on the wall says.
fn run_uncapped(world: &mut World) {
    let ticks = world.resource::<Settings>().ticks_per_step;
    world
        .resource_mut::<Time<Virtual>>()
        .set_max_delta(Duration::MAX);
    world.insert_resource(TimeUpdateStrategy::FixedTimesteps(ticks));
}

/// Runs at the beginning of every tick: every `ticks_per_step` ticks a step is over, and the agents
/// decide again.
pub(crate) fn tick(world: &mut World) {
    let ticks = world.resource::<Settings>().ticks_per_step;
    world.resource_scope(|world, mut play: Mut<Play>| {
        let has_stepped = play.ticks_left == Some(0);
        let left = play.ticks_left.filter(|left| *left > 0);
        play.ticks_left = Some(left.unwrap_or(ticks) - 1);
        if has_stepped {
            end_step(world, &mut play.player);
        }
        if left.is_none() {
            decide(world, &mut play);
            run(world, Act);
        }
    });
}

fn end_step(world: &mut World, player: &mut PolicyPlayer) {
    judge(world);
    observe(world);
    let reported = world.resource_scope(|world, stage: Mut<Stage>| {
        player.collect(&stage, |ended| {
            world.write_message(ended);
        })
    });
    if reported.is_err() {
        world.write_message(AppExit::Success);
    }
    begin_next(world);
    player.note_begun(world.resource::<Stage>());
    if player.is_idle() {
        return;
    }
    if let Some(error) = world.resource_mut::<Stage>().error.take() {
        end_with_error(world, &error, error.hint());
    }
}

/// Hands agents that policies play their actions, and leaves all others theirs.
fn decide(world: &mut World, play: &mut Play) {
    if play.player.is_idle() {
        return;
    }
    let mut stage = world.resource_mut::<Stage>();
    play.player.act(&mut stage);
    for (policy, kept) in play.kept_active.iter_mut().enumerate() {
        if !play.player.plays(policy) {
            let active = &mut stage.rosters[policy].active;
            kept.copy_from_slice(active);
            active.fill(0);
        }
    }
    run(world, ReadActions);
    let mut stage = world.resource_mut::<Stage>();
    for (policy, kept) in play.kept_active.iter().enumerate() {
        if !play.player.plays(policy) {
            stage.rosters[policy].active.copy_from_slice(kept);
        }
    }
}
