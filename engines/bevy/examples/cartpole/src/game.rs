//! The game: carts, what pushes them, and what their agents see.

use crate::motion::Cart;
use bevy_app::prelude::*;
use bevy_ecs::batching::BatchingStrategy;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_time::{Fixed, Time};
use std::f32::consts::PI;

/// Ticks of the game in a second.
pub const TICKS_PER_SECOND: f64 = 60.0;
/// The cart may go this far from the middle of the track, metres.
pub const TRACK_HALF_LENGTH: f32 = 40.0;
/// The pole may lean this far, radians.
const MAX_ANGLE: f32 = PI / 8.0;
/// Divide velocity (m/s) and angular velocity (rad/s) to about -1 … 1.
const VELOCITY_SCALE: f32 = 20.0;
const ANGULAR_VELOCITY_SCALE: f32 = 2.0;
/// Farthest start from the middle, metres.
const START_OFFSET: f32 = 1.0;
/// Largest lean at the start, radians.
const START_ANGLE: f32 = 0.05;
/// What pulls the pole down if the trainer says nothing else, m/s².
const GRAVITY: f32 = 3.7;
/// Carts that are worth a thread of their own.
const MIN_CARTS_PER_THREAD: usize = 4096;

/// Position and velocity of the cart, angle and angular velocity of the pole.
#[derive(ObservationSpace)]
pub struct CartObservation {
    /// Position, velocity, angle and angular velocity, each divided to about −1 … 1.
    pub observation: [f32; 4],
}

/// Pushes towards −z or +z.
#[derive(ActionSpace, Clone, Copy)]
#[ludus(name = "push")]
pub enum Push {
    /// Towards −z.
    Back,
    /// Towards +z.
    Forth,
}

/// The whole game, but for what runs it.
pub struct CartPolePlugin;

impl Plugin for CartPolePlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(Time::<Fixed>::from_hz(TICKS_PER_SECOND))
            .add_policy::<CartObservation, Push>(Policy::new("cart").max_episode_steps(250))
            .add_observer(fill_world)
            .add_systems(FixedUpdate, move_carts)
            .add_systems(Judge, judge)
            .add_systems(Observe, observe)
            .add_systems(Reset, begin);
    }
}

/// Puts a cart into each world.
fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
    commands.spawn((Agent::of("cart"), InWorld(add.entity), Cart::default()));
}

/// Moves all carts by one tick.
fn move_carts(time: Res<Time>, mut carts: Query<(&mut Cart, &Action<Push>)>) {
    let seconds = time.delta_secs();
    let batches = BatchingStrategy::new().min_batch_size(MIN_CARTS_PER_THREAD);
    carts
        .par_iter_mut()
        .batching_strategy(batches)
        .for_each(|(mut cart, action)| {
            let direction = match action.0 {
                Push::Back => -1.0,
                Push::Forth => 1.0,
            };
            cart.advance(direction, seconds);
        });
}

/// A point for every step; the end when the cart has left the track or the pole has fallen.
fn judge(mut carts: Query<(&Cart, &mut Reward, &mut Episode)>) {
    for (cart, mut reward, mut episode) in &mut carts {
        reward.0 = 1.0;
        if cart.position.abs() > TRACK_HALF_LENGTH || cart.angle.abs() > MAX_ANGLE {
            episode.terminate();
        }
    }
}

fn observe(mut carts: Query<(&Cart, &mut Observation<CartObservation>)>) {
    for (cart, mut seen) in &mut carts {
        seen.0.observation = [
            cart.position / TRACK_HALF_LENGTH,
            cart.velocity / VELOCITY_SCALE,
            cart.angle / MAX_ANGLE,
            cart.angular_velocity / ANGULAR_VELOCITY_SCALE,
        ];
    }
}

/// Puts the cart near the middle and the pole almost upright, both at rest.
fn begin(mut carts: Query<(&mut Cart, &Episode, &InWorld)>, mut worlds: Query<&mut LudusWorld>) {
    for (mut cart, episode, home) in &mut carts {
        if episode.is_beginning()
            && let Ok(mut world) = worlds.get_mut(home.0)
        {
            *cart = Cart {
                position: world.random.range(-START_OFFSET..START_OFFSET),
                angle: world.random.range(-START_ANGLE..START_ANGLE),
                gravity: world.number("gravity", GRAVITY),
                ..Cart::default()
            };
        }
    }
}
