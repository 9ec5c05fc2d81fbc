//! Greeting and settings (PROTOCOL.md §3).

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Lowest version of the protocol that is spoken here: a trainer of protocol 1 proves nothing.
pub const PROTOCOL_MIN: u64 = 2;
/// Highest version of the protocol that is spoken here.
pub const PROTOCOL_MAX: u64 = 2;
/// Features of this engine.
pub const CAPABILITIES: [&str; 6] = [
    "call",
    "ceiling",
    "metrics",
    "rebuild",
    "requests",
    "reset_worlds",
];
/// Longest time for which an engine may look for a request again and again, microseconds.
pub const MAX_SPIN_US: u64 = 100_000;
const DEFAULT_IDLE_TIMEOUT_S: u64 = 3600;

/// Versions of the protocol that a side speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// The lowest one.
    #[serde(deserialize_with = "super::json::whole")]
    pub min: u64,
    /// The highest one.
    #[serde(deserialize_with = "super::json::whole")]
    pub max: u64,
}

/// What an engine is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EngineName {
    /// Its name, such as `bevy`.
    pub name: String,
    /// Its version.
    pub version: String,
}

/// An engine's greeting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Versions it speaks.
    pub protocol: Versions,
    /// Version of the add-on.
    pub addon: String,
    /// What engine it is.
    pub engine: EngineName,
    /// Features it has.
    pub capabilities: Vec<String>,
    /// What the trainer's proof is about, 64 hexadecimal digits; empty in protocol 1.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub nonce: String,
    /// What a game that guides its training says of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<Value>,
}

/// The trainer's proof that it knows the token.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Challenge {
    /// The version it has chosen.
    #[serde(deserialize_with = "super::json::whole")]
    pub protocol: u64,
    /// What the engine's proof is to be about, 64 hexadecimal digits.
    pub nonce: String,
    /// The proof, 64 hexadecimal digits.
    pub proof: String,
}

/// The engine's proof that it knows the token.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Proof {
    /// The proof, 64 hexadecimal digits.
    pub proof: String,
}

/// How copies of the world are kept apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WorldLayout {
    /// As the game asks.
    #[default]
    Scene,
    /// Every world in an `App` of its own.
    Isolated,
    /// All worlds in one `App`.
    Grid,
}

/// What the trainer asks of an engine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct EngineConfig {
    /// Scene to make worlds of; none: the game's own.
    pub scene: Option<String>,
    /// Worlds in this engine.
    #[serde(deserialize_with = "super::json::whole")]
    pub num_worlds: u64,
    /// Index of its first world among all engines.
    #[serde(deserialize_with = "super::json::whole")]
    pub first_world: u64,
    /// How worlds are kept apart.
    pub layout: WorldLayout,
    /// Ticks per decision; none: what the game says.
    #[serde(deserialize_with = "super::json::whole_or_null")]
    pub ticks_per_step: Option<u64>,
    /// Steps until an episode is cut off; none: what the game says.
    #[serde(deserialize_with = "super::json::whole_or_null")]
    pub max_episode_steps: Option<u64>,
    /// How long the engine waits for the next request, seconds.
    #[serde(deserialize_with = "super::json::whole")]
    pub idle_timeout_s: u64,
    /// How long it looks for the request again and again before it sleeps, microseconds.
    #[serde(deserialize_with = "super::json::whole")]
    pub spin_us: u64,
}

impl Default for EngineConfig {
    fn default() -> Self {
        Self {
            scene: None,
            num_worlds: 1,
            first_world: 0,
            layout: WorldLayout::Scene,
            ticks_per_step: None,
            max_episode_steps: None,
            idle_timeout_s: DEFAULT_IDLE_TIMEOUT_S,
            spin_us: 0,
        }
    }
}

/// The trainer's answer to a greeting.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Welcome {
    /// The version it has chosen.
    #[serde(deserialize_with = "super::json::whole")]
    pub protocol: u64,
    /// Name and version of the trainer.
    #[serde(default)]
    pub client: String,
    /// Features that both sides have.
    #[serde(default)]
    pub capabilities: Vec<String>,
    /// What it asks of the engine.
    #[serde(default)]
    pub config: EngineConfig,
}
