//! What the page calls.

use crate::game::CartPolePlugin;
use crate::motion::Cart;
use bevy_app::TaskPoolPlugin;
use bevy_app::prelude::*;
use bevy_ludus::prelude::*;
use bevy_time::{TimePlugin, TimeUpdateStrategy};
use std::time::Duration;
use wasm_bindgen::prelude::wasm_bindgen;

const TRAINED: &[u8] = include_bytes!("../../examples/cartpole/cart.ludus.json");

/// One world with one cart.
#[wasm_bindgen]
pub struct CartPole {
    app: App,
}

#[wasm_bindgen]
impl CartPole {
    /// Begins the first episode.
    #[wasm_bindgen(constructor)]
    #[must_use]
    #[expect(clippy::new_without_default, reason = "JavaScript has no Default")]
    pub fn new() -> Self {
        let mut app = App::new();
        app.add_plugins((TaskPoolPlugin::default(), TimePlugin, CartPolePlugin))
            .add_plugins(LudusPlugin::default().name("cartpole").ticks_per_step(2))
            .add_plugins(LudusPolicyPlugin::default().policy_bytes("cart", TRAINED));
        app.finish();
        app.cleanup();
        Self { app }
    }

    /// Lets time pass, in seconds; the policy acts in it.
    pub fn advance(&mut self, seconds: f64) {
        let time = Duration::from_secs_f64(seconds.clamp(0.0, 0.1));
        self.app
            .insert_resource(TimeUpdateStrategy::ManualDuration(time));
        self.app.update();
    }

    /// Pushes the pole: changes its angular velocity, rad/s.
    pub fn push(&mut self, angular_velocity: f32) {
        let world = self.app.world_mut();
        for mut cart in world.query::<&mut Cart>().iter_mut(world) {
            cart.angular_velocity += angular_velocity;
        }
    }

    /// Returns where the cart is, in metres, and how far the pole leans, in radians.
    #[must_use]
    pub fn pose(&mut self) -> Vec<f32> {
        let world = self.app.world_mut();
        let mut carts = world.query::<&Cart>();
        carts
            .iter(world)
            .flat_map(|cart| [cart.position, cart.angle])
            .collect()
    }
}
