//! What can be wrong with bytes.

use super::{FrameType, State};
use thiserror::Error;

/// Bytes that break the protocol.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum WireError {
    /// A header names a type of frame that version 1 does not have.
    #[error("frame of unknown type {0}")]
    UnknownType(u8),
    /// A header has bits set that version 1 keeps at zero.
    #[error("{frame} frame with flags {flags}, reserved {reserved}; expected zeros")]
    Reserved {
        /// Type of the frame.
        frame: FrameType,
        /// Byte 5 of the header.
        flags: u8,
        /// Bytes 6 and 7 of the header.
        reserved: u16,
    },
    /// A header announces more bytes than its type allows.
    #[error("{frame} frame of {bytes} bytes, the limit is {limit}")]
    TooLong {
        /// Type of the frame.
        frame: FrameType,
        /// Announced length of the payload.
        bytes: usize,
        /// Longest payload of the type.
        limit: usize,
    },
    /// A payload is not a JSON object.
    #[error("{what} is not a JSON object: {reason}")]
    NotJson {
        /// What was read.
        what: String,
        /// What the JSON reader says.
        reason: String,
    },
    /// A payload has the wrong keys, types or values.
    #[error("malformed {what}: {reason}")]
    Malformed {
        /// What was read, down to the place.
        what: String,
        /// What was expected and what came.
        reason: String,
    },
    /// A binary payload has another size than it must have.
    #[error("{what} has {bytes} bytes, expected {expected}")]
    Size {
        /// What was read.
        what: &'static str,
        /// Its length.
        bytes: usize,
        /// The length that follows from the spec.
        expected: usize,
    },
    /// A frame came when it is not allowed.
    #[error("{frame} is not allowed in the state {state}")]
    OutOfTurn {
        /// Type of the frame.
        frame: FrameType,
        /// State of the conversation.
        state: State,
    },
    /// A `STEP` came before the first `RESET`.
    #[error("STEP before the first RESET")]
    StepBeforeReset,
}

impl WireError {
    pub(super) fn malformed(what: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Malformed {
            what: what.into(),
            reason: reason.into(),
        }
    }
}
