//! Worlds: isolated copies of the game, each with its own random stream.

use crate::metrics::Metrics;
use crate::random::RandomStream;
use bevy_ecs::prelude::*;
use serde_json::{Map, Value};

/// One copy of the game. Ludus spawns them; the game adds to each what is in it, in an observer:
///
/// ```
/// # use bevy_ecs::prelude::*;
/// # use bevy_ludus::prelude::*;
/// fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
///     commands.spawn((Agent::of("hero"), InWorld(add.entity)));
/// }
/// ```
#[derive(Component, Clone, Debug)]
pub struct LudusWorld {
    /// The world's random stream. Use nothing else for randomness in the game.
    pub random: RandomStream,
    /// What the trainer chose for this world, by name; survives from episode to episode.
    pub parameters: Map<String, Value>,
    pub(crate) metrics: Metrics,
    index: u64,
    seed: u64,
    num_episodes: u64,
    is_beginning: bool,
}

impl LudusWorld {
    /// Makes a world with its index among all worlds of all engines.
    #[must_use]
    pub fn new(index: u64, seed: u64) -> Self {
        Self {
            random: RandomStream::of_episode(seed, 0),
            parameters: Map::new(),
            metrics: Metrics::default(),
            index,
            seed,
            num_episodes: 0,
            is_beginning: false,
        }
    }

    /// Returns the index of this world among all worlds of all engines.
    #[must_use]
    pub fn index(&self) -> u64 {
        self.index
    }

    /// Returns how many episodes have begun since the last seeded reset.
    #[must_use]
    pub fn num_episodes(&self) -> u64 {
        self.num_episodes
    }

    /// Returns whether all agents of the world begin an episode together, in `Reset`.
    #[must_use]
    pub fn is_beginning(&self) -> bool {
        self.is_beginning
    }

    /// Returns a parameter that is a number, or what the game takes without it.
    #[must_use]
    pub fn number(&self, name: &str, default: f32) -> f32 {
        self.parameters
            .get(name)
            .and_then(Value::as_f64)
            .map_or(default, |number| number as f32)
    }

    /// Adds a value to a metric of the training run: its mean, lowest and highest value and count since
    /// the last update go to all places where metrics go, such as `metrics.jsonl` and TensorBoard. Does
    /// nothing where nobody trains the game.
    ///
    /// There may be 64 metrics, with names of 1 to 128 printable characters, without a space at either
    /// end. NaN, infinity, another name or a 65th metric ends the training with an error that names the
    /// world.
    ///
    /// ```
    /// # use bevy_ecs::prelude::*;
    /// # use bevy_ludus::prelude::*;
    /// # #[derive(Component)]
    /// # struct Jumper { height: f32 }
    /// fn land(jumpers: Query<(&Jumper, &InWorld)>, mut worlds: Query<&mut LudusWorld>) {
    ///     for (jumper, home) in &jumpers {
    ///         if let Ok(mut world) = worlds.get_mut(home.0) {
    ///             world.report_metric("height", jumper.height);
    ///         }
    ///     }
    /// }
    /// ```
    pub fn report_metric(&mut self, name: &str, value: impl Into<f64>) {
        self.metrics.report(name, value.into());
    }

    pub(crate) fn set_seed(&mut self, seed: u64) {
        self.seed = seed;
        self.num_episodes = 0;
    }

    /// Moves the random stream to the next episode.
    pub(crate) fn begin_episode(&mut self, is_of_all_agents: bool) {
        self.random = RandomStream::of_episode(self.seed, self.num_episodes);
        self.num_episodes += 1;
        self.is_beginning = is_of_all_agents;
    }

    pub(crate) fn note_begun(&mut self) {
        self.is_beginning = false;
    }

    /// Returns a fresh world that goes on where this one stands.
    pub(crate) fn successor(&self) -> Self {
        Self {
            is_beginning: false,
            ..self.clone()
        }
    }
}

/// The world that an entity belongs to. It is despawned together with that world.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[relationship(relationship_target = WorldMembers)]
pub struct InWorld(pub Entity);

/// All entities of a world.
#[derive(Component, Debug, Default)]
#[relationship_target(relationship = InWorld, linked_spawn)]
pub struct WorldMembers(Vec<Entity>);
