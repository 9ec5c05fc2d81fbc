//! Walks along coloured tiles to the white one, over the REST interface of bevy_rl: an environment
//! that was written for bevy_rl, whose agents see.
//!
//! `rest_tiles [--port=7878] [--agents=2] [--width=36] [--height=24] [--pause-interval=0]
//! [--timeout=60]`. It prints the address at which it listens, and ends when an agent sends the
//! action `quit`. Every pixel follows from the state, as `scenery.rs` says.

mod scenery;

use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolOptions, TaskPoolPlugin};
use bevy_ecs::prelude::*;
use bevy_light::LightPlugin;
use bevy_ludus::camera::RenderingPlugins;
use bevy_ludus::random::RandomStream;
use bevy_ludus_rest::*;
use bevy_pbr::PbrPlugin;
use bevy_state::prelude::*;
use serde::Serialize;

/// In the row of each agent.
const NUM_TILES: u32 = 10;
/// Each has a colour of its own.
const MAX_AGENTS: u32 = 4;

/// Goes to the tile on the left (`"0"`) or on the right (`"1"`).
type Step = u8;
type Gym = AIGymState<Step, Walkers>;

/// Where agents are, and what clients see of it.
#[derive(Clone, Debug, Serialize)]
struct Walkers {
    agents: Vec<Walker>,
}

#[derive(Clone, Debug, Default, Serialize)]
struct Walker {
    /// The tile that it stands on, counted from the left.
    tile: u32,
    /// The white tile.
    goal: u32,
}

#[derive(Resource)]
struct Game {
    walkers: Walkers,
    /// Where each one is about to go.
    steps: Vec<i32>,
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
        .add_plugins((pool, RenderingPlugins, LightPlugin, PbrPlugin::default()))
        .add_plugins(ScheduleRunnerPlugin::default())
        .insert_resource(Gym::new(settings))
        .add_plugins(AIGymPlugin::<Step, Walkers>::default())
        .insert_resource(game)
        .add_systems(Startup, (scenery::spawn_rows, scenery::spawn_eyes))
        .add_systems(PostStartup, tell)
        .add_systems(
            Update,
            (
                walk.run_if(in_state(SimulationState::Running)),
                publish.run_if(on_message::<EventPause>),
                control,
                reset,
                scenery::show,
            )
                .chain(),
        )
        .run()
}

fn read_settings(arguments: impl Iterator<Item = String>) -> Result<AIGymSettings, String> {
    let mut settings = AIGymSettings {
        num_agents: 2,
        width: 36,
        height: 24,
        render_to_buffer: true,
        // The first picture waits for its shaders.
        timeout: 60.0,
        ..Default::default()
    };
    for argument in arguments {
        let (name, value) = argument.split_once('=').unwrap_or((&argument, ""));
        match name {
            "--port" => settings.port = number(name, value)?,
            "--agents" => settings.num_agents = number(name, value)?,
            "--width" => settings.width = number(name, value)?,
            "--height" => settings.height = number(name, value)?,
            "--pause-interval" => settings.pause_interval = number(name, value)?,
            "--timeout" => settings.timeout = number(name, value)?,
            _ => return Err(format!("there is no option {name}")),
        }
    }
    if settings.num_agents > MAX_AGENTS {
        return Err(format!("--agents is at most {MAX_AGENTS}"));
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
        let agents = vec![Walker::default(); num_agents];
        let mut game = Self {
            walkers: Walkers { agents },
            steps: vec![0; num_agents],
            random: RandomStream::new(0),
        };
        game.begin();
        game
    }

    /// Puts every agent on some tile, and makes another one of its row white.
    fn begin(&mut self) {
        self.steps.fill(0);
        for walker in &mut self.walkers.agents {
            let mut below = |limit: u32| self.random.below(limit.into()) as u32;
            walker.tile = below(NUM_TILES);
            walker.goal = (walker.tile + 1 + below(NUM_TILES - 1)) % NUM_TILES;
        }
    }
}

/// Takes one step, however long the game runs until it is paused again.
fn walk(mut game: ResMut<Game>) {
    let Game { walkers, steps, .. } = &mut *game;
    for (walker, step) in walkers.agents.iter_mut().zip(steps) {
        let tile = walker.tile.saturating_add_signed(std::mem::take(step));
        walker.tile = tile.min(NUM_TILES - 1);
    }
}

/// A point, and the end, for an agent that reached the white tile.
fn publish(game: Res<Game>, gym: Res<Gym>) {
    let Ok(mut gym) = gym.lock() else { return };
    for (agent, walker) in game.walkers.agents.iter().enumerate() {
        let has_arrived = walker.tile == walker.goal;
        gym.set_reward(agent, f32::from(u8::from(has_arrived)));
        gym.set_terminated(agent, has_arrived);
    }
    gym.set_env_state(game.walkers.clone());
    gym.send_step_result(vec![true; game.walkers.agents.len()]);
}

fn control(
    mut controls: EventReader<EventControl>,
    mut game: ResMut<Game>,
    mut state: ResMut<NextState<SimulationState>>,
    mut exits: EventWriter<AppExit>,
) {
    for control in controls.read() {
        for (step, action) in game.steps.iter_mut().zip(&control.0) {
            *step = match action.as_deref() {
                Some("0") => -1,
                Some("1") => 1,
                Some("quit") => {
                    exits.write(AppExit::Success);
                    0
                }
                _ => 0,
            };
        }
        state.set(SimulationState::Running);
    }
}

fn reset(mut resets: EventReader<EventReset>, mut game: ResMut<Game>, gym: Res<Gym>) {
    for _ in resets.read() {
        game.begin();
        let Ok(mut gym) = gym.lock() else { return };
        gym.set_env_state(game.walkers.clone());
        gym.reset();
    }
}
