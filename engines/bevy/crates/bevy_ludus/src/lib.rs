//! Train agents of [Bevy](https://bevy.org) games with Ludus.
//!
//! A game declares what its agents see and decide ([`Observe`](space::Observe) and
//! [`Act`](space::Act), both derivable), spawns them in worlds, and adds [`LudusPlugin`] and
//! [`LudusTcpPlugin`]. Started by `ludus train`, it plays in lock-step with the trainer: one update
//! of the app is one step, in which the fixed schedule runs exactly `ticks_per_step` times, as fast
//! as the machine can. Started by hand, it plays on its own in real time.
//!
//! What happens in one step:
//!
//! | schedule | what runs |
//! |---|---|
//! | `First` | the set [`Exchange`](schedules::Exchange): the last answer is sent, the next request awaited |
//! | [`Act`](schedules::Act) | [`Action`](components::Action) components hold the decisions; then your systems |
//! | `FixedMain` × `ticks_per_step` | the game moves |
//! | [`Judge`](schedules::Judge) | your systems give rewards and end episodes |
//! | [`Observe`](schedules::Observe) | your systems fill [`Observation`](components::Observation) components |
//! | [`Reset`](schedules::Reset) | only if an episode has ended: your systems begin the next one, and `Observe` runs again |
//!
//! The labels of these schedules are also system sets in `RunFixedMainLoop`, to order against.

mod advance;
mod ceiling;
mod ending;
mod exchange;
mod isolated;
mod isolated_frames;
mod methods;
mod opening;
mod pace;
mod play;
mod plugin;
mod policy_player;
mod policy_plugin;
mod requests;
mod roster;
mod stage;
mod systems;
mod trainer;

#[cfg(feature = "camera")]
pub mod camera;
pub mod components;
pub mod link;
pub mod model;
pub mod policy;
pub mod random;
#[cfg(feature = "rest")]
pub mod rest;
pub mod schedules;
pub mod space;
pub mod wire;
pub mod world;

pub use methods::{Arguments, MethodResult};
pub use plugin::{LudusApp, LudusPlugin};
pub use policy_plugin::{EpisodeEnded, LudusPolicyPlugin};
pub use requests::{Mode, PolicyStatus, Requests, TrainingStatus};

pub use link::LudusTcpPlugin;

/// What most games use.
pub mod prelude {
    pub use crate::components::{Action, ActionMask, Agent, Episode, Observation, Reward};
    pub use crate::policy::Policy;
    pub use crate::random::RandomStream;
    pub use crate::schedules::{Act, ControlState, Judge, Observe, Reset};
    pub use crate::wire::{EpisodeMode, WorldLayout};
    pub use crate::world::{InWorld, LudusWorld};
    pub use crate::{EpisodeEnded, LudusApp, LudusPlugin, LudusPolicyPlugin, LudusTcpPlugin};
    pub use crate::{Requests, TrainingStatus};
    // The derive macros share their names with the schedules; they live in another namespace.
    pub use bevy_ludus_derive::{Act, Observe};
}

/// The page for users; its examples are compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../../../../docs/bevy.md")]
pub struct BevyPage;
