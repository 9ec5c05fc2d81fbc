//! The names, events and REST endpoints of bevy_rl, on the Bevy of today.
//!
//! An environment that was written for bevy_rl changes one line, `use bevy_rl::*;` to
//! `use bevy_ludus::rest::*;`, and its clients find the same four endpoints at 127.0.0.1:7878:
//! `/state`, `/step`, `/reset` and `/visual_observations`. What differs is listed in
//! `docs/bevy_rl.md`.
//!
//! The game and its clients meet like this. While the game is in
//! [`SimulationState::PausedForControl`], a request becomes an [`EventControl`] or an
//! [`EventReset`]. The game acts, goes to [`SimulationState::Running`] for a while, and is paused
//! again: the game publishes its state on [`EventPause`], and the answer goes out.

mod answer;
mod desk;
mod error;
mod events;
mod export;
mod front;
mod payload;
#[cfg(feature = "camera")]
mod pixels;
mod plugin;
mod seat;
mod server;
mod settings;
mod state;
mod turns;

pub use events::{EventControl, EventPause, EventReset, SimulationPauseTimer, SimulationState};
pub use plugin::AIGymPlugin;
pub use server::RestServer;
pub use settings::AIGymSettings;
pub use state::{AIGymState, AIGymStateInner};

// Bevy renamed these in 0.17. Environments written for bevy_rl use the older names.
pub use bevy_ecs::message::{MessageReader as EventReader, MessageWriter as EventWriter};
