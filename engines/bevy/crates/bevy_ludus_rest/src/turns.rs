//! When the game is paused, hears requests, and goes on.

use super::desk::{Ask, Desk, Kind};
use super::events::{EventControl, EventPause, EventReset, SimulationPauseTimer, SimulationState};
#[cfg(feature = "camera")]
use super::pixels::Pictures;
use super::server::RestServer;
use crate::trainer::Trainer;
use bevy_ecs::prelude::*;
use bevy_state::prelude::*;
use bevy_time::{Time, TimeUpdateStrategy};
use std::sync::Arc;
use std::time::Duration;

/// A game that waits comes up for air so often: to hear that it shall end, and to show its window.
const PULSE: Duration = Duration::from_millis(100);

/// How the game and its clients take turns.
#[derive(Resource)]
pub(super) struct Turns {
    pub desk: Arc<Desk>,
    /// How far the clock goes in one update; none where the clock is not ours.
    pub step: Option<Duration>,
    pub is_lock_step: bool,
    /// Since the last request was handed over.
    has_run: bool,
    /// Systems have had a whole update to hear of the pause.
    has_published: bool,
}

impl Turns {
    pub fn new(desk: Arc<Desk>, is_lock_step: bool, step: Option<Duration>) -> Self {
        Self {
            desk,
            step,
            is_lock_step,
            has_run: false,
            has_published: false,
        }
    }
}

/// After startup: a game that has said nothing about its state is ready.
pub(super) fn begin(
    state: Res<State<SimulationState>>,
    mut next: ResMut<NextState<SimulationState>>,
) {
    let is_untouched = matches!(*next, NextState::Unchanged);
    if is_untouched && *state.get() == SimulationState::Initializing {
        next.set(SimulationState::Running);
    }
}

/// At the beginning of an update: answers what is done, and hands over what comes next.
pub(super) fn hear(world: &mut World) {
    let (state, next) = look(world);
    let turns = world.resource::<Turns>();
    let is_paused =
        state == SimulationState::PausedForControl && next.is_none_or(|next| next == state);
    if is_paused && turns.has_published {
        let desk = Arc::clone(&turns.desk);
        note_picture(world, &desk);
        desk.finish(turns.has_run);
        if turns.is_lock_step
            && desk.is_idle()
            // The trainer has the game wait already.
            && !world.contains_resource::<Trainer>()
            && let Some(server) = world.get_resource::<RestServer>()
        {
            server.wait(PULSE);
        }
        hand_over(world, &desk);
    }
    let is_still = match look(world) {
        (_, Some(next)) => next == SimulationState::PausedForControl,
        (state, None) => state == SimulationState::PausedForControl,
    };
    set_clock(world, is_still);
}

/// Returns the state, and the one that comes next if there is one.
fn look(world: &World) -> (SimulationState, Option<SimulationState>) {
    let next = match world.resource::<NextState<SimulationState>>() {
        NextState::Unchanged => None,
        NextState::Pending(next) | NextState::PendingIfNeq(next) => Some(next.clone()),
    };
    (
        world.resource::<State<SimulationState>>().get().clone(),
        next,
    )
}

fn hand_over(world: &mut World, desk: &Desk) {
    if let Some(Ask::Step(actions)) = desk.take(Kind::Step) {
        world.write_message(EventControl(actions));
    } else if desk.take(Kind::Reset).is_some() {
        world.write_message(EventReset);
    } else if desk.take(Kind::Picture).is_some() {
        want_picture(world);
    } else {
        return;
    }
    world.resource_mut::<Turns>().has_run = false;
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
fn note_picture(world: &World, desk: &Desk) {
    let pictures = world.get_resource::<Pictures>();
    if pictures.is_some_and(Pictures::is_taken) {
        desk.note_result(Kind::Picture);
    }
}

#[cfg(not(feature = "camera"))]
fn note_picture(_: &World, _: &Desk) {}

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
            turns.has_run = true;
            turns.has_published = false;
            let is_leaving = matches!(*next, NextState::Pending(SimulationState::Initializing));
            if is_time && !is_leaving {
                next.set(SimulationState::PausedForControl);
                pauses.write(EventPause);
            }
        }
    }
}
