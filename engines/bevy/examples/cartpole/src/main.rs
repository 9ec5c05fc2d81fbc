//! Balances a pole that is hinged on a cart by pushing the cart left and right: the task of the
//! Godot example of the same name, with the equations of motion in place of a physics engine.

mod motion;
#[cfg(feature = "view")]
mod view;

use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolPlugin};
use bevy_ecs::batching::BatchingStrategy;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_time::{Fixed, Time, TimePlugin};
use motion::Cart;
use std::f32::consts::PI;
use std::time::Duration;

const TICKS_PER_SECOND: f64 = 60.0;
/// The cart may go this far from the middle of the track, metres.
const TRACK_HALF_LENGTH: f32 = 40.0;
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
/// Plays while no trainer is there.
const TRAINED: &[u8] = include_bytes!("../cart.ludus.json");
/// Carts that are worth a thread of their own.
const MIN_CARTS_PER_THREAD: usize = 4096;

/// Position and velocity of the cart, angle and angular velocity of the pole.
#[derive(ObservationSpace)]
struct CartObservation {
    observation: [f32; 4],
}

/// Pushes towards −z or +z.
#[derive(ActionSpace, Clone, Copy)]
#[ludus(name = "push")]
enum Push {
    Back,
    Forth,
}

fn main() -> AppExit {
    let frame = Duration::from_secs_f64(1.0 / TICKS_PER_SECOND);
    App::new()
        .add_plugins((TaskPoolPlugin::default(), TimePlugin))
        .add_plugins((ScheduleRunnerPlugin::run_loop(frame), CartPolePlugin))
        .add_plugins(
            LudusPlugin::default()
                .name("cartpole")
                .ticks_per_step(2)
                .isolated_by(|app| {
                    app.add_plugins((TaskPoolPlugin::default(), TimePlugin, CartPolePlugin));
                })
                .layout(WorldLayout::Grid),
        )
        .add_plugins(LudusPolicyPlugin::default().policy_bytes("cart", TRAINED))
        .add_plugins(LudusTcpPlugin::default())
        .run()
}

/// The whole game, but for what runs it.
struct CartPolePlugin;

impl Plugin for CartPolePlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(Time::<Fixed>::from_hz(TICKS_PER_SECOND))
            .add_policy::<CartObservation, Push>(Policy::new("cart").max_episode_steps(250))
            .add_observer(fill_world)
            .add_systems(FixedUpdate, move_carts)
            .add_systems(Judge, judge)
            .add_systems(Observe, observe)
            .add_systems(Reset, begin);
        #[cfg(feature = "view")]
        app.add_plugins(view::ViewPlugin);
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
