//! Why a game cannot go on, in the words that its maker reads.

#[cfg(feature = "camera")]
use crate::camera::PictureError;
#[cfg(feature = "trainer")]
use crate::metrics::MetricError;
use crate::model::PolicyFileError;
use crate::wire::WireError;
use bevy_app::AppExit;
use bevy_ecs::prelude::*;
use thiserror::Error;

/// A mistake in the game, or in what it was given.
#[derive(Clone, Debug, Error, PartialEq)]
pub(crate) enum GameError {
    #[error("the app has no policy; call app.add_policy::<O, A>(Policy::new(…))")]
    NoPolicy,
    #[error("no agent has the policy {0}")]
    NoAgent(String),
    #[error("an agent has the policy \"{name}\"; the app has: {known}")]
    UnknownPolicy { name: String, known: String },
    #[error(
        "an agent of the policy {0} is in no world: spawn it with InWorld(world), in an observer of \
         LudusWorld"
    )]
    AgentWithoutWorld(String),
    #[error("world {world} has {count} slots of the policy {policy}, world 0 has {expected}")]
    UnequalWorlds {
        world: usize,
        policy: String,
        count: usize,
        expected: usize,
    },
    #[error(
        "after a rebuild, a world has {count} slots of the policy {policy}, expected {expected}"
    )]
    Rebuilt {
        policy: String,
        count: usize,
        expected: usize,
    },
    #[error("the game has despawned world {0}")]
    WorldDespawned(usize),
    #[error(
        "an agent of the policy {0} has joined, and its world has no free slot of its policy; raise \
         spare_slots()"
    )]
    NoFreeSlot(String),
    #[error("{place}: ActionMask: expected {expected} bytes, got {got}")]
    MaskSize {
        place: String,
        expected: usize,
        got: usize,
    },
    #[error("{0}")]
    Spec(#[from] WireError),
    #[error("policy {name}: the game has no such policy; it has: {known}")]
    NoSuchPolicy { name: String, known: String },
    #[error("policy {policy}: {place}: {error}")]
    PolicyFile {
        policy: String,
        /// Where the file is.
        place: String,
        error: PolicyFileError,
    },
    #[cfg(feature = "trainer")]
    #[error("world {world} (entity {entity}): {error}")]
    Metric {
        /// In this engine (PROTOCOL.md §9).
        world: usize,
        entity: Entity,
        error: MetricError,
    },
    #[cfg(feature = "trainer")]
    #[error("the game cannot make an app for each world")]
    NotDivisible,
    #[cfg(feature = "trainer")]
    #[error("world {0} has other agents than world 0")]
    UnlikeWorlds(usize),
    #[cfg(feature = "trainer")]
    #[error("world {world}: {error}")]
    InWorld { world: usize, error: Box<GameError> },
    #[cfg(feature = "trainer")]
    #[error("{ran} ticks have run, expected {expected}")]
    Ticks { ran: u64, expected: u64 },
    #[cfg(feature = "camera")]
    #[error("{0}")]
    Picture(#[from] PictureError),
}

impl GameError {
    /// Returns what to do about it; empty where the message says so itself.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::NoSuchPolicy { .. } => "name one of the game's policies",
            Self::PolicyFile { error, .. } => error.hint(),
            #[cfg(feature = "trainer")]
            Self::NotDivisible => {
                "give LudusPlugin a function with isolated_by(), or use the layout grid"
            }
            #[cfg(feature = "trainer")]
            Self::InWorld { error, .. } => error.hint(),
            #[cfg(feature = "trainer")]
            Self::Ticks { .. } => "neither pause Time<Virtual> in training nor change its speed",
            #[cfg(feature = "camera")]
            Self::Picture(error) => error.hint(),
            _ => "",
        }
    }
}

/// Prints why the game ends, and lets it.
pub(crate) fn end_with_error(world: &mut World, error: &dyn std::fmt::Display, hint: &str) {
    print_error(error, hint);
    world.write_message(AppExit::error());
}

/// Prints an error for people who read the game's output.
#[allow(clippy::print_stderr)]
pub(crate) fn print_error(error: &dyn std::fmt::Display, hint: &str) {
    eprintln!("ludus: {error}");
    if !hint.is_empty() {
        eprintln!("hint: {hint}");
    }
}
