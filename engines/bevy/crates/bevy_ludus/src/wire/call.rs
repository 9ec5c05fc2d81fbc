//! `CALL` and `RESULT` payloads (PROTOCOL.md §8).

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// A method call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Call {
    /// Number that the result repeats.
    #[serde(deserialize_with = "super::json::whole")]
    pub id: u64,
    /// Target: a world, an agent, or the add-on itself.
    #[serde(default)]
    pub target: Map<String, Value>,
    /// Name of the method.
    pub method: String,
    /// What it is given.
    #[serde(default)]
    pub arguments: Vec<Value>,
}

impl Call {
    /// Returns whether the add-on itself is called.
    #[must_use]
    pub fn is_for_bridge(&self) -> bool {
        self.target.get("bridge") == Some(&Value::Bool(true))
    }

    /// Returns the world that is called, or in which an agent is.
    #[must_use]
    pub fn world(&self) -> Option<usize> {
        self.target
            .get("world")?
            .as_u64()
            .and_then(|world| usize::try_from(world).ok())
    }

    /// Returns the path of the agent that is called.
    #[must_use]
    pub fn agent(&self) -> Option<&str> {
        self.target.get("agent")?.as_str()
    }

    /// Returns an argument that is a whole number.
    #[must_use]
    pub fn whole_argument(&self, index: usize) -> Option<u64> {
        self.arguments.get(index)?.as_u64()
    }
}

/// What a call returned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CallResult {
    /// Number of the call.
    #[serde(deserialize_with = "super::json::whole")]
    pub id: u64,
    /// The value, or why there is none.
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// The value of a call, or why there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// The call failed.
    Error(String),
    /// The call returned this.
    Value(Value),
}

impl CallResult {
    /// Answers a call: `Err` is why it failed.
    #[must_use]
    pub fn of(call: &Call, outcome: Result<Value, String>) -> Self {
        let outcome = outcome.map_or_else(Outcome::Error, Outcome::Value);
        Self {
            id: call.id,
            outcome,
        }
    }
}
