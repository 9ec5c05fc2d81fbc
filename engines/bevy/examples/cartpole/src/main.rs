//! Balances a pole that is hinged on a cart by pushing the cart left and right: the task of the
//! Godot example of the same name, with the equations of motion in place of a physics engine.

mod game;
mod motion;
#[cfg(feature = "view")]
mod view;

use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolPlugin};
use bevy_ludus::prelude::*;
use bevy_time::TimePlugin;
use game::{CartPolePlugin, TICKS_PER_SECOND};
use std::time::Duration;

/// Plays while no trainer is there.
const TRAINED: &[u8] = include_bytes!("../cart.ludus.json");

fn main() -> AppExit {
    let frame = Duration::from_secs_f64(1.0 / TICKS_PER_SECOND);
    let mut app = App::new();
    app.add_plugins((TaskPoolPlugin::default(), TimePlugin))
        .add_plugins((ScheduleRunnerPlugin::run_loop(frame), CartPolePlugin))
        .add_plugins(
            LudusPlugin::default()
                .name("cartpole")
                .ticks_per_step(2)
                .isolated_by(|app| {
                    app.add_plugins((TaskPoolPlugin::default(), TimePlugin, CartPolePlugin));
                    #[cfg(feature = "view")]
                    app.add_plugins(view::ViewPlugin);
                })
                .layout(WorldLayout::Grid),
        )
        .add_plugins(LudusPolicyPlugin::default().policy_bytes("cart", TRAINED))
        .add_plugins(LudusTcpPlugin::default());
    #[cfg(feature = "view")]
    app.add_plugins(view::ViewPlugin);
    app.run()
}
