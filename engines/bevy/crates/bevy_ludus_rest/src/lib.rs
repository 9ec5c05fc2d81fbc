//! The names, events and REST endpoints of bevy_rl, on the Bevy of today.
//!
//! An environment that was written for bevy_rl changes one line, `use bevy_rl::*;` to
//! `use bevy_ludus_rest::*;`, and its clients find the same four endpoints at 127.0.0.1:7878:
//! `/state`, `/step`, `/reset` and `/visual_observations`. What differs is listed in
//! `docs/bevy_rl.md` of Ludus.
//!
//! ```no_run
//! use bevy_app::prelude::*;
//! use bevy_ecs::prelude::*;
//! use bevy_ludus_rest::*;
//! use bevy_state::prelude::*;
//!
//! type Gym = AIGymState<String, i64>;
//!
//! fn main() -> AppExit {
//!     let settings = AIGymSettings { num_agents: 1, ..Default::default() };
//!     App::new()
//!         .insert_resource(Gym::new(settings))
//!         .add_plugins((bevy_app::ScheduleRunnerPlugin::default(), AIGymPlugin::<String, i64>::default()))
//!         .add_systems(Update, (count, publish))
//!         .run()
//! }
//!
//! /// A client steps: `EventControl` brings its actions.
//! fn count(
//!     mut controls: MessageReader<EventControl>,
//!     mut next: ResMut<NextState<SimulationState>>,
//! ) {
//!     for _actions in controls.read() {
//!         next.set(SimulationState::Running);
//!     }
//! }
//!
//! /// The game is paused again: what clients are to see is published.
//! fn publish(mut pauses: MessageReader<EventPause>, gym: Res<Gym>, mut steps: Local<i64>) {
//!     for _ in pauses.read() {
//!         *steps += 1;
//!         if let Ok(mut gym) = gym.lock() {
//!             gym.set_env_state(*steps);
//!         }
//!     }
//! }
//! ```
//!
//! # Two ways to hear of requests
//!
//! **By events.** While the game is in [`SimulationState::PausedForControl`], a request becomes an
//! [`EventControl`] or an [`EventReset`]. The game acts, goes to [`SimulationState::Running`] for a
//! while, and is paused again: the game publishes its state on [`EventPause`], and the answer goes
//! out.
//!
//! **By polling**, with states of its own, as bevy_rl's documentation of versions 0.7 to 0.9 shows:
//! the game asks [`is_next_action`](AIGymStateInner::is_next_action) and
//! [`is_reset_request`](AIGymStateInner::is_reset_request), takes the request with
//! [`receive_action_strings`](AIGymStateInner::receive_action_strings) or
//! [`receive_reset_request`](AIGymStateInner::receive_reset_request), and answers with
//! [`send_step_result`](AIGymStateInner::send_step_result) or
//! [`send_reset_result`](AIGymStateInner::send_reset_result). A game that has polled once is sent no
//! more events.
//!
//! # Versions of Bevy
//!
//! | `bevy_ludus_rest` | Bevy | stands in for bevy_rl |
//! |---|---|---|
//! | 0.1 | 0.19 | 0.7 to 0.16 |

mod answer;
mod connections;
mod driver;
mod error;
mod events;
mod export;
mod game_handle;
mod guard;
mod payload;
#[cfg(feature = "camera")]
mod pixels;
mod plugin;
mod queue;
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
