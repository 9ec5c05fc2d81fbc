//! The plugin through which a game brings its trained policies along.

#[cfg(feature = "trainer")]
use crate::link::CommandLine;
use crate::model::{PolicyFileError, PolicyModel};
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use std::borrow::Cow;
use std::path::PathBuf;

/// Plays agents with trained policies, without a trainer and without Python.
///
/// Decisions and episodes follow the rules of training: an action lasts
/// [`ticks_per_step`](crate::LudusPlugin::ticks_per_step) ticks, in real time. Agents of other
/// policies are left to the game. A trainer that connects wins.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_ludus::prelude::*;
/// let policies = LudusPolicyPlugin::default().policy("hero", "assets/hero.ludus.json");
/// App::new().add_plugins((LudusPlugin::default(), policies));
/// ```
///
/// A file that is wrong, or does not fit the agents, ends the game with an error. Files that the
/// command line names (`--ludus-policy=hero=PATH`) go before those of the plugin.
#[derive(Clone, Debug, Default)]
pub struct LudusPolicyPlugin {
    sources: PolicySources,
}

impl LudusPolicyPlugin {
    /// Plays the agents of a policy by a file, which is read when the game starts.
    #[must_use]
    pub fn policy(mut self, name: impl Into<String>, path: impl Into<PathBuf>) -> Self {
        self.sources.set(name.into(), Source::File(path.into()));
        self
    }

    /// Plays the agents of a policy by the bytes of a file, such as `include_bytes!` puts into the
    /// executable.
    #[must_use]
    pub fn policy_bytes(
        mut self,
        name: impl Into<String>,
        bytes: impl Into<Cow<'static, [u8]>>,
    ) -> Self {
        self.sources.set(name.into(), Source::Bytes(bytes.into()));
        self
    }

    /// Draws actions as in training; otherwise the most probable ones are taken.
    #[must_use]
    pub fn sampling(mut self) -> Self {
        self.sources.sample_actions = true;
        self
    }

    /// Sets the seed of the world and of drawn actions; otherwise the clock does.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.sources.seed = Some(seed);
        self
    }
}

impl Plugin for LudusPolicyPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.sources.clone());
    }
}

/// An episode of an agent that a policy plays has ended: a message.
#[derive(Message, Clone, Debug, PartialEq)]
pub struct EpisodeEnded {
    /// Name of the policy.
    pub policy: String,
    /// The agent; none if it has left.
    pub agent: Option<Entity>,
    /// Sum of the rewards of the episode.
    pub episode_return: f64,
    /// Steps of the episode.
    pub num_steps: u32,
}

/// Where a policy is.
#[derive(Clone, Debug)]
enum Source {
    File(PathBuf),
    Bytes(Cow<'static, [u8]>),
}

/// The policies of a game, and how they are played.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct PolicySources {
    sources: Vec<(String, Source)>,
    pub sample_actions: bool,
    /// Whether a line is printed for every episode that ends.
    pub has_report: bool,
    /// Whether every update of the app is a step, whatever the clock on the wall says.
    pub is_uncapped: bool,
    pub seed: Option<u64>,
}

impl PolicySources {
    fn set(&mut self, name: String, source: Source) {
        self.sources.retain(|(own, _)| *own != name);
        self.sources.push((name, source));
    }

    /// Takes over what the command line says.
    #[cfg(feature = "trainer")]
    pub fn overlay(&mut self, arguments: &CommandLine) {
        for (name, path) in &arguments.policies {
            self.set(name.clone(), Source::File(path.clone()));
        }
        self.sample_actions |= arguments.sample_actions;
        self.has_report |= arguments.has_report;
        self.is_uncapped |= arguments.is_headless && !arguments.is_real_time;
    }

    /// Reads the policies one by one; with each come its name and where it is, for messages.
    pub fn load(
        &self,
    ) -> impl Iterator<Item = (&str, String, Result<PolicyModel, PolicyFileError>)> {
        self.sources.iter().map(|(name, source)| match source {
            Source::File(path) => {
                let place = path.display().to_string();
                (name.as_str(), place, PolicyModel::load(path))
            }
            Source::Bytes(bytes) => {
                let place = "in the executable".to_owned();
                (name.as_str(), place, PolicyModel::read(bytes))
            }
        })
    }
}
