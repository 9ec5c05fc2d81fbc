//! What the plugin tells the environment, and the states between.

use bevy_ecs::event::Event;
use bevy_ecs::message::Message;
use bevy_ecs::resource::Resource;
use bevy_ecs::schedule::SystemSet;
use bevy_state::state::States;
use bevy_time::Timer;

/// A client wants a new episode: rebuild the world, and call
/// [`reset`](super::AIGymStateInner::reset).
#[derive(Clone, Copy, Debug, Event, Message, PartialEq, Eq)]
pub struct EventReset;

/// A client sends actions, one text or none per agent: apply them, and go to
/// [`SimulationState::Running`].
#[derive(Clone, Debug, Event, Message, PartialEq, Eq)]
pub struct EventControl(pub Vec<Option<String>>);

/// The game is paused: publish its state with
/// [`set_env_state`](super::AIGymStateInner::set_env_state).
#[derive(Clone, Copy, Debug, Event, Message, PartialEq, Eq)]
pub struct EventPause;

/// Whether time passes. Also a system set for each state.
#[derive(Clone, Debug, Default, Eq, Hash, PartialEq, States, SystemSet)]
pub enum SimulationState {
    /// The game loads. Games that set a state in a startup system (this one as well) say
    /// themselves when they are ready; others are taken to be ready after it.
    Initializing,
    /// Time passes until the next pause.
    #[default]
    Running,
    /// Everything stands still until a client sends the next request.
    PausedForControl,
}

/// Pauses the game whenever [`pause_interval`](super::AIGymSettings::pause_interval) has passed.
#[derive(Debug, Resource)]
pub struct SimulationPauseTimer(pub(super) Timer);
