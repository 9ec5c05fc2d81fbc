//! What runs when. The labels are schedules to add systems to, and sets to order against.

use bevy_ecs::schedule::{ScheduleLabel, SystemSet};
use bevy_state::prelude::*;

/// Set in `First`: the answer is sent, and the next request awaited.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, SystemSet)]
pub struct Exchange;

/// Runs once per step, before its ticks: all `Action` components hold the new decisions. As a set
/// in `RunFixedMainLoop`, it is that run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel, SystemSet)]
pub struct Act;

/// Runs once per step, after its ticks: the place to give rewards and to end episodes by what has
/// come of the step. As a set in `RunFixedMainLoop`, it is that run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel, SystemSet)]
pub struct Judge;

/// Runs after [`Judge`], and once more after [`Reset`]: the game fills `Observation` components
/// (and masks). As a set in `RunFixedMainLoop`, it is that first run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel, SystemSet)]
pub struct Observe;

/// Runs when episodes begin: the game sets up the agents whose `Episode::is_beginning()`, and the
/// worlds whose `LudusWorld::is_beginning()`. As a set in `RunFixedMainLoop`, it is that run, and
/// the run of `Observe` that follows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel, SystemSet)]
pub struct Reset;

/// What the app does. The state of an app in which one isolated world lives is always `Running`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, States)]
pub enum ControlState {
    /// Time passes.
    #[default]
    Running,
    /// Everything stands still until the trainer sends the next request.
    PausedForControl,
    /// Episodes begin.
    Reset,
}
