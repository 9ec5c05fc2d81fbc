//! What happens around the ticks of one step, in the app that holds the worlds.

use crate::ending::{begin_world, collect, mark_next, note_begun};
use crate::error::GameError;
use crate::opening::rebuild;
use crate::schedules::{Act, ControlState, Judge, Observe, Reset};
use crate::stage::{Pass, Settings, Stage};
use crate::systems::{ReadActions, WriteRows};
use crate::wire::ResetAction;
use crate::world::LudusWorld;
use bevy_ecs::prelude::*;
// On the web, the clock of the standard library panics; this one is the browser's there.
use bevy_state::prelude::*;
use serde_json::Value;
use web_time::Instant;

/// What a `RESET` does to one world.
#[derive(Clone, Debug)]
pub(crate) struct WorldReset {
    pub action: ResetAction,
    pub seed: u64,
    /// Null where the world keeps its parameters.
    pub parameters: Value,
}

/// Hands the actions to the agents.
pub(crate) fn apply_actions(world: &mut World) {
    let began = Instant::now();
    run(world, ReadActions);
    run(world, Act);
    let mut stage = world.resource_mut::<Stage>();
    let now = Instant::now();
    stage.applied_at = now;
    stage.bridge_time += now - began;
}

/// Lets the game judge the step, after its ticks.
pub(crate) fn judge(world: &mut World) {
    run(world, Judge);
    let mut stage = world.resource_mut::<Stage>();
    stage.game_time = stage.applied_at.elapsed();
}

/// Observes what has come of the step and collects it.
pub(crate) fn observe(world: &mut World) {
    let began = Instant::now();
    observe_pass(world, Pass::All);
    run_cached(world, collect);
    world.resource_mut::<Stage>().bridge_time += began.elapsed();
}

/// Begins the next episodes, and completes the batch.
pub(crate) fn begin_next(world: &mut World) {
    let began = Instant::now();
    let mode = world.resource::<Settings>().episode;
    let stage = world.resource::<Stage>();
    if !stage.ended.is_empty() || !stage.newcomers.is_empty() {
        let marked = mark_next(world, mode);
        set_up(world, marked);
    }
    finish(world, began);
}

/// Resets worlds, as a `RESET` asks.
pub(crate) fn reset_worlds(world: &mut World, resets: &[WorldReset]) {
    let began = Instant::now();
    let is_seeding_all = resets.iter().all(|reset| reset.action == ResetAction::Seed);
    let rebuilt = if is_seeding_all {
        rebuild(world)
    } else {
        Ok(())
    };
    let marked = rebuilt.and_then(|()| {
        world.resource_scope(|world, mut stage: Mut<Stage>| {
            stage.clear_outcomes();
            stage.game_time = std::time::Duration::ZERO;
            let is_reset = |number: &usize| resets[*number].action != ResetAction::Leave;
            (0..resets.len()).filter(is_reset).try_for_each(|number| {
                prepare(world, &stage, number, &resets[number]);
                begin_world(world, &mut stage, number)
            })
        })
    });
    set_up(world, marked);
    finish(world, began);
}

fn prepare(world: &mut World, stage: &Stage, number: usize, reset: &WorldReset) {
    if let Some(mut ludus_world) = world.get_mut::<LudusWorld>(stage.worlds[number]) {
        if let Value::Object(parameters) = &reset.parameters {
            ludus_world.parameters.clone_from(parameters);
        }
        if reset.action == ResetAction::Seed {
            ludus_world.set_seed(reset.seed);
        }
    }
}

/// Lets the game set up the episodes that begin, and observes them.
fn set_up(world: &mut World, marked: Result<(), GameError>) {
    if let Err(error) = marked {
        world.resource_mut::<Stage>().error = Some(error);
        return;
    }
    enter(world, ControlState::Reset);
    run(world, Reset);
    observe_pass(world, Pass::Beginning);
    note_begun(world);
}

fn finish(world: &mut World, began: Instant) {
    let mut stage = world.resource_mut::<Stage>();
    stage.clear_ended_rows();
    stage.write_active();
    stage.is_stepping = false;
    stage.bridge_time += began.elapsed();
}

fn observe_pass(world: &mut World, pass: Pass) {
    world.resource_mut::<Stage>().pass = pass;
    run(world, Observe);
    run(world, WriteRows);
    #[cfg(feature = "camera")]
    crate::camera::draw_observations(world);
}

/// Changes the state at once. Apps of isolated worlds always run.
pub(crate) fn enter(world: &mut World, state: ControlState) {
    if world.resource::<Settings>().is_isolated {
        return;
    }
    let is_there = world
        .get_resource::<State<ControlState>>()
        .is_some_and(|now| *now == state);
    if !is_there {
        world.resource_mut::<NextState<ControlState>>().set(state);
        run(world, StateTransition);
    }
}

/// Runs a schedule of this crate; they are all made by the plugin.
pub(crate) fn run(world: &mut World, label: impl bevy_ecs::schedule::ScheduleLabel) {
    let is_run = world.try_run_schedule(label);
    debug_assert!(is_run.is_ok(), "the plugin makes all schedules");
}

fn run_cached<M>(world: &mut World, system: impl IntoSystem<(), (), M> + 'static) {
    let is_run = world.run_system_cached(system);
    debug_assert!(is_run.is_ok(), "the stage exists");
}
