//! When the game is paused, hears of requests, and goes on.

use super::events::{EventControl, EventPause, EventReset, SimulationPauseTimer, SimulationState};
#[cfg(feature = "camera")]
use super::pixels::Pictures;
#[cfg(feature = "camera")]
use super::queue::Kind;
use super::queue::{Ask, RequestQueue};
use super::server::RestServer;
use bevy_ecs::prelude::*;
use bevy_ludus::has_trainer;
use bevy_state::prelude::*;
use bevy_time::{Time, TimeUpdateStrategy};
use std::sync::Arc;
use std::time::Duration;

/// A game that waits still updates this often: to notice that it is to end, and to show its window.
const PULSE: Duration = Duration::from_millis(100);

/// How the game and its clients take turns.
#[derive(Resource)]
pub(super) struct Turns {
    pub queue: Arc<RequestQueue>,
    /// How far the clock goes in one update; none where the clock is not ours.
    step: Option<Duration>,
    is_lock_step: bool,
    /// Systems have had a whole update to hear of the pause.
    has_published: bool,
}

impl Turns {
    pub fn new(queue: Arc<RequestQueue>, is_lock_step: bool, step: Option<Duration>) -> Self {
        Self {
            queue,
            step,
            is_lock_step,
            has_published: false,
        }
    }
}

/// After startup: takes a game that has said nothing about its state for ready.
pub(super) fn leave_initializing(
    state: Res<State<SimulationState>>,
    mut next: ResMut<NextState<SimulationState>>,
) {
    let is_untouched = matches!(*next, NextState::Unchanged);
    if is_untouched && *state.get() == SimulationState::Initializing {
        next.set(SimulationState::Running);
    }
}

/// At the beginning of an update: answers what is done, and passes on what comes next.
pub(super) fn serve_requests(world: &mut World) {
    let turns = world.resource::<Turns>();
    let queue = Arc::clone(&turns.queue);
    if is_pausing(world) && turns.has_published && is_paused(world) {
        note_picture(world, &queue);
        queue.finish();
        // A trainer of Ludus has the game wait already.
        if turns.is_lock_step
            && queue.is_idle()
            && !has_trainer(world)
            && let Some(server) = world.get_resource::<RestServer>()
        {
            server.wait(PULSE);
        }
        send_event(world, &queue);
    }
    let is_still = is_pausing(world) && !queue.needs_time();
    set_clock(world, is_still);
    queue.begin_update();
}

fn is_paused(world: &World) -> bool {
    *world.resource::<State<SimulationState>>().get() == SimulationState::PausedForControl
}

/// Returns whether the game is paused in this update: it is already, or will be before its systems
/// run.
fn is_pausing(world: &World) -> bool {
    match world.resource::<NextState<SimulationState>>() {
        NextState::Unchanged => is_paused(world),
        NextState::Pending(next) | NextState::PendingIfNeq(next) => {
            *next == SimulationState::PausedForControl
        }
    }
}

fn send_event(world: &mut World, queue: &RequestQueue) {
    match queue.take_for_event() {
        Some(Ask::Step(actions)) => {
            world.write_message(EventControl(actions));
        }
        Some(Ask::Reset) => {
            world.write_message(EventReset);
        }
        Some(Ask::Picture) => want_picture(world),
        None => {}
    }
}

#[cfg(feature = "camera")]
fn want_picture(world: &World) {
    if let Some(pictures) = world.get_resource::<Pictures>() {
        pictures.want();
    }
}

#[cfg(not(feature = "camera"))]
fn want_picture(_: &World) {}

/// A picture is done when the renderer has taken it.
#[cfg(feature = "camera")]
fn note_picture(world: &World, queue: &RequestQueue) {
    let pictures = world.get_resource::<Pictures>();
    if pictures.is_some_and(Pictures::is_taken) {
        queue.note_result(Kind::Picture);
    }
}

#[cfg(not(feature = "camera"))]
fn note_picture(_: &World, _: &RequestQueue) {}

/// In lock-step the clock goes on by the same time in every update, and stands still in a pause.
fn set_clock(world: &mut World, is_still: bool) {
    if let Some(step) = world.resource::<Turns>().step {
        let time = if is_still { Duration::ZERO } else { step };
        world.insert_resource(TimeUpdateStrategy::ManualDuration(time));
    }
}

/// At the end of an update: pauses the game when it is time to.
pub(super) fn pause(
    mut turns: ResMut<Turns>,
    state: Res<State<SimulationState>>,
    mut next: ResMut<NextState<SimulationState>>,
    time: Res<Time>,
    mut timer: ResMut<SimulationPauseTimer>,
    mut pauses: MessageWriter<EventPause>,
) {
    let is_time = timer.0.tick(time.delta()).just_finished() || turns.is_lock_step;
    match state.get() {
        SimulationState::Initializing => (),
        SimulationState::PausedForControl => turns.has_published = true,
        SimulationState::Running => {
            turns.queue.note_run();
            turns.has_published = false;
            let is_leaving = matches!(*next, NextState::Pending(SimulationState::Initializing));
            if is_time && !is_leaving {
                next.set(SimulationState::PausedForControl);
                pauses.write(EventPause);
            }
        }
    }
}
