//! Games written as bevy_rl's documentation of versions 0.7 to 0.9 shows: states of their own, and
//! systems that poll.

use crate::client::Client;
use crate::game::Running;
use bevy_app::TaskPoolPlugin;
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus_rest::*;
use bevy_state::app::{AppExtStates, StatesPlugin};
use bevy_state::prelude::*;
use bevy_time::{Time, TimePlugin, Timer, TimerMode};
use serde::Serialize;
use serde_json::{Value, json};

const NUM_AGENTS: u32 = 2;
/// The game runs this long per action: 5 updates of lock-step.
const CONTROL_INTERVAL: f32 = 5.0 / 60.0;

type Gym = AIGymState<i64, EnvironmentState>;

#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq, States)]
enum AppState {
    #[default]
    InGame,
    Control,
    Reset,
}

/// What clients see.
#[derive(Clone, Debug, Default, Resource, Serialize)]
struct EnvironmentState {
    positions: [i64; NUM_AGENTS as usize],
    speeds: [i64; NUM_AGENTS as usize],
    num_episodes: u32,
    num_actions: u32,
}

#[derive(Resource)]
struct DelayedControlTimer(Timer);

fn build(app: &mut App, settings: AIGymSettings) {
    app.add_plugins((TaskPoolPlugin::default(), TimePlugin, StatesPlugin))
        .insert_resource(Gym::new(settings))
        .add_plugins(AIGymPlugin::<i64, EnvironmentState>::default())
        .init_state::<AppState>()
        .init_resource::<EnvironmentState>()
        .insert_resource(DelayedControlTimer(Timer::from_seconds(
            CONTROL_INTERVAL,
            TimerMode::Repeating,
        )))
        .add_systems(
            Update,
            (
                (drive, control_switch)
                    .chain()
                    .run_if(in_state(AppState::InGame)),
                (process_control_request, process_reset_request)
                    .run_if(in_state(AppState::Control)),
            ),
        )
        .add_systems(OnEnter(AppState::Reset), reset_environment);
}

/// The game itself: agents move in every update in which time passes.
fn drive(mut environment: ResMut<EnvironmentState>, time: Res<Time>) {
    if time.delta().is_zero() {
        return;
    }
    let EnvironmentState {
        positions, speeds, ..
    } = &mut *environment;
    for (position, speed) in positions.iter_mut().zip(speeds) {
        *position += *speed;
    }
}

fn control_switch(
    mut next: ResMut<NextState<AppState>>,
    time: Res<Time>,
    mut timer: ResMut<DelayedControlTimer>,
    gym: Res<Gym>,
    environment: Res<EnvironmentState>,
) {
    if timer.0.tick(time.delta()).just_finished() {
        next.set(AppState::Control);
        let mut gym = gym.lock().unwrap();
        let results = (0..gym.settings.num_agents).map(|_| true).collect();
        gym.send_step_result(results);
        for (agent, position) in environment.positions.iter().enumerate() {
            gym.set_reward(agent, *position as f32);
        }
        gym.set_env_state(environment.clone());
    }
}

fn process_control_request(
    gym: Res<Gym>,
    mut next: ResMut<NextState<AppState>>,
    mut environment: ResMut<EnvironmentState>,
) {
    let gym = gym.lock().unwrap();
    if !gym.is_next_action() {
        return;
    }
    environment.num_actions += 1;
    for (agent, action) in gym.receive_action_strings().into_iter().enumerate() {
        environment.speeds[agent] = action.map_or(0, |action| action.parse().unwrap());
    }
    next.set(AppState::InGame);
}

fn process_reset_request(gym: Res<Gym>, mut next: ResMut<NextState<AppState>>) {
    let gym = gym.lock().unwrap();
    if gym.is_reset_request() {
        gym.receive_reset_request();
        next.set(AppState::Reset);
    }
}

fn reset_environment(
    gym: Res<Gym>,
    mut environment: ResMut<EnvironmentState>,
    mut next: ResMut<NextState<AppState>>,
) {
    *environment = EnvironmentState {
        num_episodes: environment.num_episodes + 1,
        ..EnvironmentState::default()
    };
    let mut gym = gym.lock().unwrap();
    gym.set_env_state(environment.clone());
    gym.reset();
    next.set(AppState::InGame);
}

fn start(pause_interval: f32) -> Running {
    let settings = AIGymSettings {
        num_agents: NUM_AGENTS,
        no_graphics: true,
        port: 0,
        pause_interval,
        timeout: 10.0,
        ..Default::default()
    };
    Running::start(|app| build(app, settings))
}

fn state(client: &mut Client) -> Value {
    serde_json::from_str(&client.get("/state")).unwrap()
}

#[test]
fn polled_steps_are_answered_after_they_were_played() {
    let game = start(0.0);
    let mut client = Client::connect(game.address);
    for turn in 1..=20 {
        let answer: Value = serde_json::from_str(&client.step(&["1", "-2"])).unwrap();
        let seen = state(&mut client);
        // In lock-step an action lasts the same number of updates, each time.
        assert_eq!(
            seen["positions"],
            json!([5 * turn, -10 * turn]),
            "turn {turn}"
        );
        assert_eq!(seen["num_actions"], turn);
        assert_eq!(answer[0]["reward"], f64::from(5 * turn));
    }
}

#[test]
fn polled_resets_begin_episodes_between_steps() {
    for first in ["reset", "step"] {
        let game = start(0.0);
        let mut client = Client::connect(game.address);
        if first == "step" {
            client.step(&["3", "3"]);
        }
        for episode in 1..=3 {
            let answer: Value = serde_json::from_str(&client.get("/reset")).unwrap();
            assert_eq!(answer[0]["reward"], 0.0);
            assert_eq!(state(&mut client)["num_episodes"], episode);
            assert_eq!(state(&mut client)["positions"], json!([0, 0]));
            client.step(&["1", "0"]);
            assert_eq!(
                state(&mut client)["positions"],
                json!([5, 0]),
                "after a {first}"
            );
        }
    }
}

#[test]
fn a_polling_game_with_a_timer_plays_each_action_once() {
    let game = start(0.001);
    let mut client = Client::connect(game.address);
    for turn in 1..=4 {
        client.step(&["1", "0"]);
        assert_eq!(state(&mut client)["num_actions"], turn);
    }
    client.get("/reset");
    assert_eq!(state(&mut client)["num_actions"], 0);
}

#[test]
fn a_polling_game_that_waits_rests() {
    let game = start(0.0);
    let mut client = Client::connect(game.address);
    client.step(&["1", "0"]);
    let before = state(&mut client);
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(state(&mut client), before);
}
