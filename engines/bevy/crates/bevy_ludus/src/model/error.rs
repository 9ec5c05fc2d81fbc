//! What can be wrong with a policy file.

use std::path::PathBuf;
use thiserror::Error;

/// A policy file that cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum PolicyFileError {
    /// The system does not let it be read.
    #[error("cannot read {path}: {reason}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// It is longer than a policy file may be.
    #[error("it has more than {limit} bytes")]
    TooLong {
        /// Most bytes of a policy file.
        limit: usize,
    },
    /// It is not a JSON object.
    #[error("it is not a JSON object: {0}")]
    NotJson(String),
    /// A field is missing, of the wrong type or over a limit, or does not fit the others.
    #[error("{place}: {reason}")]
    Malformed {
        /// The field, such as `layers[0].weight`.
        place: String,
        /// What was expected and what came.
        reason: String,
    },
    /// It was trained for other agents than those of the game.
    #[error("{place}: {reason}")]
    Incompatible {
        /// The entry or component.
        place: String,
        /// What the policy has and what the agents have.
        reason: String,
    },
}

impl PolicyFileError {
    pub(super) fn malformed(place: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Malformed {
            place: place.into(),
            reason: reason.into(),
        }
    }

    /// Returns what to do about it.
    #[must_use]
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } => {
                "name the file by a path that holds from where the game runs"
            }
            Self::Incompatible { .. } => "train a policy for this game, or change the game back",
            _ => "export the policy again with `ludus export`",
        }
    }
}
