//! Train agents of [Bevy](https://bevy.org) games with Ludus.
//!
//! A game declares what its agents see and decide ([`ObservationSpace`](space::ObservationSpace) and
//! [`ActionSpace`](space::ActionSpace), both derivable), spawns them in worlds, and adds
//! [`LudusPlugin`] and [`LudusTcpPlugin`]. Started by `ludus train`, it plays in lock-step with the
//! trainer: one update of the app is one step, in which the fixed schedule runs exactly
//! `ticks_per_step` times, as fast as the machine can. Started by hand, it plays on its own in real
//! time, by trained policies if [`LudusPolicyPlugin`] is there.
//!
//! # The smallest game
//!
//! A coin lies on one side or the other, and the agent says which.
//!
//! ```no_run
//! use bevy_app::prelude::*;
//! use bevy_ecs::prelude::*;
//! use bevy_ludus::prelude::*;
//!
//! #[derive(ObservationSpace)]
//! struct Coin {
//!     is_heads: bool,
//! }
//!
//! #[derive(ActionSpace, Clone, Copy, PartialEq)]
//! enum Guess {
//!     Tails,
//!     Heads,
//! }
//!
//! fn main() -> AppExit {
//!     App::new()
//!         .add_plugins((LudusPlugin::default().name("coin"), LudusTcpPlugin::default()))
//!         .add_policy::<Coin, Guess>(Policy::new("guesser"))
//!         .add_observer(|add: On<Add, LudusWorld>, mut commands: Commands| {
//!             commands.spawn((Agent::of("guesser"), InWorld(add.entity)));
//!         })
//!         .add_systems(Judge, judge)
//!         .add_systems(Observe, toss)
//!         .run()
//! }
//!
//! fn judge(mut agents: Query<(&Observation<Coin>, &Action<Guess>, &mut Reward, &mut Episode)>) {
//!     for (coin, guess, mut reward, mut episode) in &mut agents {
//!         reward.0 = f32::from(coin.0.is_heads == (guess.0 == Guess::Heads));
//!         episode.terminate();
//!     }
//! }
//!
//! fn toss(
//!     mut agents: Query<(&mut Observation<Coin>, &InWorld)>,
//!     mut worlds: Query<&mut LudusWorld>,
//! ) {
//!     for (mut coin, home) in &mut agents {
//!         if let Ok(mut world) = worlds.get_mut(home.0) {
//!             coin.0.is_heads = world.random.below(2) == 1;
//!         }
//!     }
//! }
//! ```
//!
//! ```sh
//! cargo build --release && ludus train target/release/coin
//! ```
//!
//! # What happens in one step
//!
//! | schedule | what runs |
//! |---|---|
//! | `First` | the set [`LudusSystems::Exchange`](schedules::LudusSystems): the last answer is sent, the next request awaited |
//! | [`Act`](schedules::Act) | [`Action`](components::Action) components hold the decisions; then your systems |
//! | `FixedMain` × `ticks_per_step` | the game moves |
//! | [`Judge`](schedules::Judge) | your systems give rewards and end episodes |
//! | [`Observe`](schedules::Observe) | your systems fill [`Observation`](components::Observation) components |
//! | [`Reset`](schedules::Reset) | only if an episode has ended: your systems begin the next one, and `Observe` runs again |
//!
//! # Features
//!
//! | feature | on by default | what it adds |
//! |---|---|---|
//! | `trainer` | yes | the connection to a trainer. Without it a game plays its policies and opens no socket and no thread, also on the web |
//! | `camera` | no | agents that see through cameras, and pictures for films; it needs Bevy's rendering crates |
//!
//! # Versions of Bevy
//!
//! | `bevy_ludus` | Bevy | Rust |
//! |---|---|---|
//! | 0.1 | 0.19 | 1.95 |
//!
//! A crate for clients and environments of bevy_rl is `bevy_ludus_rest`.

#[cfg(feature = "rest")]
compile_error!(
    "the feature `rest` of bevy_ludus is the crate `bevy_ludus_rest` now: add it to Cargo.toml, and \
     write `use bevy_ludus_rest::*;` for `use bevy_ludus::rest::*;`"
);

mod advance;
mod ending;
mod error;
mod methods;
mod metrics;
mod opening;
mod play;
mod plugin;
mod policy_player;
mod policy_plugin;
mod requests;
mod roster;
mod sensor;
mod stage;
mod systems;
#[cfg(feature = "trainer")]
mod training;

#[cfg(feature = "camera")]
pub mod camera;
pub mod components;
#[cfg(feature = "trainer")]
pub mod link;
pub mod model;
pub mod policy;
pub mod random;
pub mod schedules;
pub mod space;
pub mod wire;
pub mod world;

pub use methods::{Arguments, MethodResult};
pub use plugin::{LudusApp, LudusPlugin};
pub use policy_plugin::{EpisodeEnded, LudusPolicyPlugin};
pub use requests::{Mode, PolicyStatus, Requests, TrainingStatus};
pub use sensor::Sensor;

#[cfg(feature = "trainer")]
pub use link::LudusTcpPlugin;

/// Returns whether a trainer plays the game now; never without the feature `trainer`.
#[must_use]
pub fn has_trainer(world: &bevy_ecs::world::World) -> bool {
    #[cfg(feature = "trainer")]
    return world.contains_resource::<training::Trainer>();
    #[cfg(not(feature = "trainer"))]
    {
        let _ = world;
        false
    }
}

/// What most games use.
pub mod prelude {
    #[cfg(feature = "trainer")]
    pub use crate::LudusTcpPlugin;
    pub use crate::components::{Action, ActionMask, Agent, Episode, Observation, Reward};
    pub use crate::policy::Policy;
    pub use crate::random::RandomStream;
    pub use crate::schedules::{Act, ControlState, Judge, Observe, Reset};
    pub use crate::wire::{EpisodeMode, WorldLayout};
    pub use crate::world::{InWorld, LudusWorld};
    pub use crate::{EpisodeEnded, LudusApp, LudusPlugin, LudusPolicyPlugin};
    pub use crate::{Requests, Sensor, TrainingStatus};
    // Only the macros; the traits of the same names are in `space`.
    pub use bevy_ludus_derive::{ActionSpace, ObservationSpace};
}

/// The page for users; its examples are compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../docs/bevy.md")]
pub struct BevyPage;
