//! What runs when: schedules to add systems to, and the sets to order other systems against.

use bevy_app::SubApp;
use bevy_ecs::schedule::{ScheduleLabel, Schedules, SingleThreadedExecutor, SystemSet};
use bevy_state::prelude::*;
use bevy_tasks::ComputeTaskPool;

/// Runs once per step, before its ticks: all `Action` components hold the new decisions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel)]
pub struct Act;

/// Runs once per step, after its ticks: the place to give rewards and to end episodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel)]
pub struct Judge;

/// Runs after [`Judge`], and once more after [`Reset`]: the game fills `Observation` components
/// (and masks).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel)]
pub struct Observe;

/// Runs when episodes begin: the game sets up the agents whose `Episode::is_beginning()`, and the
/// worlds whose `LudusWorld::is_beginning()`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ScheduleLabel)]
pub struct Reset;

/// When Ludus runs its schedules, and talks with the trainer.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_app::RunFixedMainLoop;
/// # use bevy_ecs::prelude::*;
/// use bevy_ludus::schedules::LudusSystems;
///
/// # fn read_gamepad() {}
/// App::new().add_systems(RunFixedMainLoop, read_gamepad.before(LudusSystems::Act));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, SystemSet)]
pub enum LudusSystems {
    /// In `First`: the last answer is sent, and the next request awaited.
    Exchange,
    /// In `RunFixedMainLoop`: actions are read, and the schedule [`Act`] runs.
    Act,
    /// In `RunFixedMainLoop`: the schedule [`Judge`] runs.
    Judge,
    /// In `RunFixedMainLoop`: the schedule [`Observe`] runs, and rows are written.
    Observe,
    /// In `RunFixedMainLoop`: the schedule [`Reset`] runs if episodes begin, then [`Observe`] for
    /// them.
    Reset,
}

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

/// Lets the schedules of an app run on its own thread where Bevy's task pool has no second one.
///
/// A trainer gives each engine one core. There, handing systems to a thread costs more than most of
/// them take.
pub fn fit_executors_to_cores(app: &mut SubApp) {
    if ComputeTaskPool::try_get().is_none_or(|pool| pool.thread_num() <= 1) {
        run_on_one_thread(app);
    }
}

/// Lets all schedules of an app run on the thread that runs the app.
pub(crate) fn run_on_one_thread(app: &mut SubApp) {
    for (_, schedule) in app.world_mut().resource_mut::<Schedules>().iter_mut() {
        schedule.set_executor(SingleThreadedExecutor::new());
    }
}
