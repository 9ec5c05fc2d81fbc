//! Balances poles that are hinged on carts, over the REST interface of bevy_rl: the task of the
//! example `cartpole`, as an environment that was written for bevy_rl.
//!
//! `rest_cartpole [--port=7878] [--agents=1] [--pause-interval=0] [--timeout=30]`. It prints the
//! address at which it listens, and ends when an agent sends the action `quit`.

#[path = "../../../examples/cartpole/src/motion.rs"]
mod motion;

use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolOptions, TaskPoolPlugin};
use bevy_ecs::prelude::*;
use bevy_ludus::random::RandomStream;
use bevy_ludus_rest::*;
use bevy_state::prelude::*;
use motion::Cart;
use serde::Serialize;
use std::f32::consts::PI;

const SECONDS_PER_TICK: f32 = 1.0 / 60.0;
const TICKS_PER_STEP: usize = 2;
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
/// What pulls the pole down, m/s².
const GRAVITY: f32 = 3.7;

/// Pushes towards −z (`"0"`) or +z (`"1"`).
type Push = u8;
type Gym = AIGymState<Push, Carts>;

/// Of each cart: place, speed, lean and speed of the lean, each about -1 … 1.
#[derive(Clone, Debug, Default, Serialize)]
struct Carts {
    agents: Vec<[f32; 4]>,
}

/// All carts, and which way each is pushed.
#[derive(Resource)]
struct Game {
    carts: Vec<Cart>,
    directions: Vec<f32>,
    /// Actions have come that have not had their effect yet.
    is_pushed: bool,
    random: RandomStream,
}

fn main() -> AppExit {
    match read_settings(std::env::args().skip(1)) {
        Ok(settings) => play(settings),
        Err(error) => refuse(&error),
    }
}

fn play(settings: AIGymSettings) -> AppExit {
    let game = Game::new(settings.num_agents as usize);
    // The systems take less time than handing them to threads would.
    let pool = TaskPoolPlugin {
        task_pool_options: TaskPoolOptions::with_num_threads(1),
    };
    App::new()
        .add_plugins((pool, ScheduleRunnerPlugin::default()))
        .insert_resource(Gym::new(settings))
        .add_plugins(AIGymPlugin::<Push, Carts>::default())
        .insert_resource(game)
        .add_systems(PostStartup, tell)
        .add_systems(
            Update,
            (
                advance.run_if(in_state(SimulationState::Running)),
                publish.run_if(on_message::<EventPause>),
                control,
                reset,
            )
                .chain(),
        )
        .run()
}

fn read_settings(arguments: impl Iterator<Item = String>) -> Result<AIGymSettings, String> {
    let mut settings = AIGymSettings {
        num_agents: 1,
        ..Default::default()
    };
    for argument in arguments {
        let (name, value) = argument.split_once('=').unwrap_or((&argument, ""));
        match name {
            "--port" => settings.port = number(name, value)?,
            "--agents" => settings.num_agents = number(name, value)?,
            "--pause-interval" => settings.pause_interval = number(name, value)?,
            "--timeout" => settings.timeout = number(name, value)?,
            _ => return Err(format!("there is no option {name}")),
        }
    }
    Ok(settings)
}

fn number<T: std::str::FromStr>(name: &str, value: &str) -> Result<T, String> {
    value
        .parse()
        .map_err(|_| format!("{name} takes a number, not '{value}'"))
}

#[allow(clippy::print_stderr)]
fn refuse(error: &str) -> AppExit {
    eprintln!("{error}");
    AppExit::error()
}

/// Says where the game listens.
#[allow(clippy::print_stdout)]
fn tell(server: Option<Res<RestServer>>) {
    if let Some(server) = server {
        println!("http://{}", server.address());
    }
}

impl Game {
    fn new(num_agents: usize) -> Self {
        let carts = vec![Cart::default(); num_agents];
        let directions = vec![0.0; num_agents];
        let mut game = Self {
            carts,
            directions,
            is_pushed: false,
            random: RandomStream::new(0),
        };
        game.begin();
        game
    }

    /// Puts the carts near the middle and the poles almost upright, all at rest.
    fn begin(&mut self) {
        for cart in &mut self.carts {
            *cart = Cart {
                position: self.random.range(-START_OFFSET..START_OFFSET),
                angle: self.random.range(-START_ANGLE..START_ANGLE),
                gravity: GRAVITY,
                ..Cart::default()
            };
        }
    }

    fn observe(&self) -> Carts {
        let rows = self.carts.iter().map(|cart| {
            [
                cart.position / TRACK_HALF_LENGTH,
                cart.velocity / VELOCITY_SCALE,
                cart.angle / MAX_ANGLE,
                cart.angular_velocity / ANGULAR_VELOCITY_SCALE,
            ]
        });
        Carts {
            agents: rows.collect(),
        }
    }
}

/// Moves the carts by one step, however long the game runs until it is paused again.
fn advance(mut game: ResMut<Game>) {
    if !std::mem::take(&mut game.is_pushed) {
        return;
    }
    let Game {
        carts, directions, ..
    } = &mut *game;
    for (cart, direction) in carts.iter_mut().zip(directions) {
        for _ in 0..TICKS_PER_STEP {
            cart.advance(*direction, SECONDS_PER_TICK);
        }
    }
}

/// A point for every step; the end when a cart has left the track or its pole has fallen.
fn publish(game: Res<Game>, gym: Res<Gym>) {
    let Ok(mut gym) = gym.lock() else { return };
    for (agent, cart) in game.carts.iter().enumerate() {
        let is_lost = cart.position.abs() > TRACK_HALF_LENGTH || cart.angle.abs() > MAX_ANGLE;
        gym.set_reward(agent, 1.0);
        gym.set_terminated(agent, is_lost);
    }
    gym.set_env_state(game.observe());
    gym.send_step_result(vec![true; game.carts.len()]);
}

fn control(
    mut controls: EventReader<EventControl>,
    mut game: ResMut<Game>,
    mut state: ResMut<NextState<SimulationState>>,
    mut exits: EventWriter<AppExit>,
) {
    for control in controls.read() {
        if control
            .0
            .iter()
            .any(|action| action.as_deref() == Some("quit"))
        {
            exits.write(AppExit::Success);
        }
        for (direction, action) in game.directions.iter_mut().zip(&control.0) {
            *direction = match action.as_deref() {
                Some("0") => -1.0,
                Some("1") => 1.0,
                _ => 0.0,
            };
        }
        game.is_pushed = true;
        state.set(SimulationState::Running);
    }
}

fn reset(mut resets: EventReader<EventReset>, mut game: ResMut<Game>, gym: Res<Gym>) {
    for _ in resets.read() {
        game.begin();
        let Ok(mut gym) = gym.lock() else { return };
        gym.set_env_state(game.observe());
        gym.reset();
    }
}
