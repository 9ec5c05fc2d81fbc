//! `ERROR` payloads (PROTOCOL.md §9).

use serde::{Deserialize, Serialize};

/// Kind of a mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ErrorCode {
    /// No protocol version that both sides know.
    Version,
    /// Missing or wrong token.
    Token,
    /// Bad settings, or a game that cannot be trained.
    Config,
    /// The game's own mistake.
    Game,
    /// A frame the state does not allow.
    Sequence,
    /// A malformed frame.
    Frame,
    /// A deadline has passed.
    Timeout,
    /// The trainer trains another game.
    Busy,
    /// The game has cameras, and nothing that draws.
    Renderer,
    /// A mistake in Ludus.
    Internal,
}

/// What went wrong, for the other side.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ErrorReport {
    /// Kind of the mistake.
    pub code: ErrorCode,
    /// What happened, what was expected, what came, and where.
    pub message: String,
    /// What to do; may be empty.
    #[serde(default)]
    pub hint: String,
}
