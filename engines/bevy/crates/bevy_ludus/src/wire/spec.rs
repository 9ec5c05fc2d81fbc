//! What an engine declares: worlds, policies, spaces (PROTOCOL.md §4).

use super::spec_rules;
use super::{WireError, read_object};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Type of the numbers of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DType {
    /// 32-bit floats.
    Float32,
    /// Bytes; images are these, channels last.
    Uint8,
    /// 64-bit integers.
    Int64,
}

impl DType {
    /// Returns the size of one number, bytes.
    #[must_use]
    pub fn num_bytes(self) -> usize {
        match self {
            Self::Float32 => 4,
            Self::Uint8 => 1,
            Self::Int64 => 8,
        }
    }
}

/// A bound of every element, or one per element.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Bound {
    /// The same for all elements.
    All(f64),
    /// One per element.
    Each(Vec<f64>),
}

impl Bound {
    /// Returns the bound of one element.
    #[must_use]
    pub fn of(&self, element: usize) -> Option<f64> {
        match self {
            Self::All(value) => Some(*value),
            Self::Each(values) => values.get(element).copied(),
        }
    }
}

/// One named array of an observation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservationEntry {
    /// Its name.
    pub name: String,
    /// Type of its numbers.
    pub dtype: DType,
    /// Its shape.
    #[serde(deserialize_with = "super::json::whole_list")]
    pub shape: Vec<usize>,
    /// Smallest values; none: unbounded.
    #[serde(default)]
    pub low: Option<Bound>,
    /// Largest values; none: unbounded.
    #[serde(default)]
    pub high: Option<Bound>,
}

impl ObservationEntry {
    /// Returns the number of its elements.
    #[must_use]
    pub fn size(&self) -> usize {
        self.shape.iter().product()
    }

    /// Returns the size of one agent's row, bytes.
    #[must_use]
    pub fn row_bytes(&self) -> usize {
        self.size() * self.dtype.num_bytes()
    }
}

/// A choice, or some numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum ActionKind {
    /// One of 0 … n − 1.
    Discrete {
        /// Number of alternatives.
        #[serde(deserialize_with = "super::json::whole")]
        n: u64,
    },
    /// Numbers between bounds.
    Continuous {
        /// Count of numbers.
        #[serde(deserialize_with = "super::json::whole")]
        size: u64,
        /// Smallest values.
        low: Bound,
        /// Largest values.
        high: Bound,
    },
}

/// One named part of an action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionComponent {
    /// Its name.
    pub name: String,
    /// A choice, or some numbers.
    #[serde(flatten)]
    pub kind: ActionKind,
}

/// When an episode ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EpisodeMode {
    /// Each agent's episode ends by itself.
    #[default]
    Agent,
    /// Agents that end wait until all agents of their world have ended.
    World,
}

/// An agent of a policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AgentSpec {
    /// The world it is in.
    #[serde(deserialize_with = "super::json::whole")]
    pub world: u64,
    /// What it is called in its world; none: a slot kept free.
    pub path: Option<String>,
}

/// Agents that share a network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolicySpec {
    /// Name of the policy.
    pub name: String,
    /// Its agents in all worlds.
    #[serde(deserialize_with = "super::json::whole")]
    pub num_agents: u64,
    /// Its agents in one world.
    #[serde(deserialize_with = "super::json::whole")]
    pub agents_per_world: u64,
    /// When an episode ends.
    pub episode: EpisodeMode,
    /// Steps until an episode is cut off.
    #[serde(deserialize_with = "super::json::whole_or_null")]
    pub max_episode_steps: Option<u64>,
    /// What its agents see, in wire order.
    pub observation: Vec<ObservationEntry>,
    /// What its agents decide, in wire order.
    pub action: Vec<ActionComponent>,
    /// Whether batches say which choices are allowed.
    pub has_action_mask: bool,
    /// One per slot.
    pub agents: Vec<AgentSpec>,
    /// Training settings, by the trainer's names.
    pub settings: Map<String, Value>,
}

impl PolicySpec {
    /// Returns the number of alternatives of each choice.
    pub fn choices(&self) -> impl Iterator<Item = u64> + '_ {
        self.action
            .iter()
            .filter_map(|component| match component.kind {
                ActionKind::Discrete { n } => Some(n),
                ActionKind::Continuous { .. } => None,
            })
    }

    /// Returns the count of all numbers of an action.
    #[must_use]
    pub fn continuous_size(&self) -> usize {
        let sizes = self.action.iter().map(|component| match component.kind {
            ActionKind::Discrete { .. } => 0,
            ActionKind::Continuous { size, .. } => size as usize,
        });
        sizes.sum()
    }

    /// Returns the length of one agent's action mask, bytes; 0 without one.
    #[must_use]
    pub fn mask_size(&self) -> usize {
        if self.has_action_mask {
            self.choices().sum::<u64>() as usize
        } else {
            0
        }
    }
}

/// What an engine declares.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spec {
    /// Worlds in the engine.
    #[serde(deserialize_with = "super::json::whole")]
    pub num_worlds: u64,
    /// How they are kept apart: isolated or grid.
    pub layout: super::WorldLayout,
    /// Ticks per decision.
    #[serde(deserialize_with = "super::json::whole")]
    pub ticks_per_step: u64,
    /// Ticks per second of game time.
    pub tick_rate: f64,
    /// Name of the game.
    #[serde(default)]
    pub scene: String,
    /// Its policies, in wire order.
    pub policies: Vec<PolicySpec>,
}

impl Spec {
    /// Reads the payload of a `SPEC`.
    ///
    /// # Errors
    /// It is not a JSON object, a key is missing or of the wrong type, or a rule of PROTOCOL.md is
    /// broken.
    pub fn decode(payload: &[u8]) -> Result<Self, WireError> {
        let spec: Self = read_object(payload, "SPEC")?;
        spec.validate()?;
        Ok(spec)
    }

    /// Checks all rules and limits of PROTOCOL.md.
    ///
    /// # Errors
    /// One is broken; the text names the place.
    pub fn validate(&self) -> Result<(), WireError> {
        spec_rules::check(self)
    }
}
