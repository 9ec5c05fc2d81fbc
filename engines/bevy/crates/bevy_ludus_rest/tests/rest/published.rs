//! The calls of bevy_rl's own REST test, and the answers it expects: five agents that walk.

use crate::client::Client;
use crate::game::Running;
use bevy_app::TaskPoolPlugin;
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus_rest::*;
use bevy_state::prelude::*;
use bevy_time::TimePlugin;
use serde::Serialize;

const NUM_AGENTS: usize = 5;

type Gym = AIGymState<String, Walkers>;

#[derive(Clone, Default, Serialize)]
struct Walker {
    location: (f32, f32),
    health: f32,
}

#[derive(Clone, Resource, Serialize)]
struct Walkers {
    agents: Vec<Walker>,
}

fn publish(mut pauses: EventReader<EventPause>, walkers: Res<Walkers>, gym: Res<Gym>) {
    for _ in pauses.read() {
        gym.lock().unwrap().set_env_state(walkers.clone());
    }
}

fn walk(
    mut controls: EventReader<EventControl>,
    mut walkers: ResMut<Walkers>,
    mut next: ResMut<NextState<SimulationState>>,
) {
    for EventControl(actions) in controls.read() {
        for (walker, action) in walkers.agents.iter_mut().zip(actions) {
            let (x, y) = match action.as_deref() {
                Some("LEFT") => (-1.0, 0.0),
                Some("RIGHT") => (1.0, 0.0),
                Some("DOWN") => (0.0, -1.0),
                Some("UP") => (0.0, 1.0),
                _ => (0.0, 0.0),
            };
            walker.location.0 += x;
            walker.location.1 += y;
        }
        next.set(SimulationState::Running);
    }
}

fn fill(app: &mut App) {
    let settings = AIGymSettings {
        num_agents: NUM_AGENTS as u32,
        render_to_buffer: false,
        pause_interval: 0.000_1,
        port: 0,
        ..Default::default()
    };
    let agents = vec![Walker::default(); NUM_AGENTS];
    app.add_plugins((TaskPoolPlugin::default(), TimePlugin))
        .insert_resource(Gym::new(settings))
        .add_plugins(AIGymPlugin::<String, Walkers>::default())
        .insert_resource(Walkers { agents })
        .add_systems(Update, (publish, walk));
}

/// Returns the state that clients are shown.
fn shown(locations: [&str; NUM_AGENTS]) -> String {
    let agents = locations.map(|at| format!(r#"{{"health":0.0,"location":[{at}]}}"#));
    format!(r#"{{"agents":[{}]}}"#, agents.join(","))
}

#[test]
fn the_calls_of_bevy_rls_test_get_its_answers() {
    let game = Running::start(fill);
    let mut client = Client::connect(game.address);
    while client.get("/state") == "null" {
        std::thread::yield_now();
    }
    assert_eq!(client.get("/state"), shown(["0.0,0.0"; NUM_AGENTS]));
    let answer = client.step(&["DOWN", "UP", "LEFT", "RIGHT", "IDLE"]);
    let expected = [r#"{"is_terminated":false,"reward":0.0}"#; NUM_AGENTS];
    assert_eq!(answer, format!("[{}]", expected.join(",")));
    let walked = ["0.0,-1.0", "0.0,1.0", "-1.0,0.0", "1.0,0.0", "0.0,0.0"];
    assert_eq!(client.get("/state"), shown(walked));
}
