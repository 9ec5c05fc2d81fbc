//! A small game that counts its ticks.

use crate::trainer::Session;
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use serde_json::{Value, json};

/// Ticks since the episode began, its random number, the last choice, the wind.
#[derive(ObservationSpace)]
pub struct Seen {
    pub observation: [f32; 4],
}

#[derive(ActionSpace)]
pub struct Choice {
    #[ludus(n = 4)]
    pub choice: u8,
}

pub const END: u8 = 1;
pub const CUT: u8 = 2;
pub const LEAVE: u8 = 3;

#[derive(Component, Default)]
pub struct Counter {
    pub ticks: f32,
    pub number: f32,
    pub wind: f32,
}

/// How the game is made.
#[derive(Clone, Copy)]
pub struct Game {
    pub policy: fn() -> Policy,
    pub plugin: fn() -> LudusPlugin,
    pub agents: usize,
}

impl Default for Game {
    fn default() -> Self {
        Self {
            policy: || Policy::new("hero").max_episode_steps(10),
            plugin: || LudusPlugin::default().ticks_per_step(3).name("counter"),
            agents: 1,
        }
    }
}

#[derive(Resource)]
pub struct NumAgents(pub usize);

impl Game {
    pub fn fill(self, app: &mut App) {
        app.add_policy::<Seen, Choice>((self.policy)())
            .insert_resource(NumAgents(self.agents))
            .add_observer(fill_world)
            .add_systems(FixedUpdate, count)
            .add_systems(Act, act)
            .add_systems(Observe, observe)
            .add_systems(Reset, begin);
    }

    pub fn open(self, config: &Value) -> Session {
        Session::open(move |app| self.build(app), config)
    }

    pub fn build(self, app: &mut App) {
        self.fill(app);
        app.add_plugins((self.plugin)());
    }
}

pub fn fill_world(add: On<Add, LudusWorld>, count: Res<NumAgents>, mut commands: Commands) {
    for _ in 0..count.0 {
        commands.spawn((Agent::of("hero"), InWorld(add.entity), Counter::default()));
    }
}

pub fn count(mut counters: Query<(&mut Counter, &mut Reward)>) {
    for (mut counter, mut reward) in &mut counters {
        counter.ticks += 1.0;
        reward.0 += 0.5;
    }
}

pub fn act(mut agents: Query<(Entity, &Action<Choice>, &mut Episode)>, mut commands: Commands) {
    for (entity, action, mut episode) in &mut agents {
        match action.0.choice {
            END => episode.terminate(),
            CUT => episode.truncate(),
            LEAVE => commands.entity(entity).despawn(),
            _ => {}
        }
    }
}

pub fn observe(mut agents: Query<(&Counter, &Action<Choice>, &mut Observation<Seen>)>) {
    for (counter, action, mut seen) in &mut agents {
        let choice = f32::from(action.0.choice);
        seen.0.observation = [counter.ticks, counter.number, choice, counter.wind];
    }
}

pub fn begin(
    mut agents: Query<(&mut Counter, &Episode, &InWorld)>,
    mut worlds: Query<&mut LudusWorld>,
) {
    for (mut counter, episode, home) in &mut agents {
        let mut world = worlds.get_mut(home.0).expect("its world");
        if episode.is_beginning() {
            counter.ticks = 0.0;
            counter.number = world.random.unit();
            counter.wind = world.number("wind", 0.25);
        }
    }
}

pub fn worlds(count: u64) -> Value {
    json!({"num_worlds": count})
}

pub fn seeds(first: u64, count: u64) -> Vec<Option<u64>> {
    (first..first + count).map(Some).collect()
}

/// Plays some steps and returns everything that was seen.
pub fn record(session: &mut Session, first_seed: u64) -> Vec<Vec<Vec<f32>>> {
    session.reset(&seeds(first_seed, session.spec.num_worlds), Value::Null);
    let mut all = vec![session.seen(0)];
    for step in 0..20 {
        session.step(i64::from(step % 7 == 6));
        all.push(session.seen(0));
    }
    all
}

/// A game whose worlds may have an app each.
pub fn divisible() -> Game {
    let isolated = || {
        let fill = |app: &mut App| Game::default().fill(app);
        LudusPlugin::default().ticks_per_step(3).isolated_by(fill)
    };
    Game {
        plugin: isolated,
        ..Game::default()
    }
}
