//! The conversation's state machine as a table (PROTOCOL.md §2), from the engine's side.

use super::{FrameType, WireError};
use std::fmt;

/// State of a conversation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// Nothing was said yet.
    Connected,
    /// The engine has greeted.
    Greeted,
    /// The trainer has proved itself.
    Challenged,
    /// The engine has proved itself.
    Proven,
    /// The trainer has told its settings.
    Configured,
    /// The engine waits for a request.
    Ready,
    /// A `RESET` or `STEP` waits for its `BATCH`.
    Stepping,
    /// A `CALL` waits for its `RESULT`.
    Calling,
    /// A `PING` waits for its `PONG`.
    Pinging,
    /// The conversation is over.
    Closed,
}

impl fmt::Display for State {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", format!("{self:?}").to_uppercase())
    }
}

/// Follows one conversation and refuses frames that are out of turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionState {
    state: State,
    has_reset: bool,
}

impl Default for ConnectionState {
    fn default() -> Self {
        Self {
            state: State::Connected,
            has_reset: false,
        }
    }
}

impl ConnectionState {
    /// Returns the state of the conversation.
    #[must_use]
    pub fn state(self) -> State {
        self.state
    }

    /// Notes that the engine sends a frame.
    ///
    /// # Errors
    /// The frame is not allowed now.
    pub fn send(&mut self, frame: FrameType) -> Result<(), WireError> {
        let following = match (self.state, frame) {
            (State::Closed, _) => None,
            (_, FrameType::Error | FrameType::Close) => Some(State::Closed),
            (State::Connected, FrameType::Hello) => Some(State::Greeted),
            (State::Challenged, FrameType::Proof) => Some(State::Proven),
            (State::Configured, FrameType::Spec)
            | (State::Stepping, FrameType::Batch)
            | (State::Calling, FrameType::Result)
            | (State::Pinging, FrameType::Pong) => Some(State::Ready),
            _ => None,
        };
        self.follow(frame, following)
    }

    /// Notes that the trainer sent a frame.
    ///
    /// # Errors
    /// The frame is not allowed now.
    pub fn receive(&mut self, frame: FrameType) -> Result<(), WireError> {
        let following = match (self.state, frame) {
            (State::Closed, _) => None,
            (_, FrameType::Error | FrameType::Close) => Some(State::Closed),
            (State::Greeted, FrameType::Challenge) => Some(State::Challenged),
            (State::Proven, FrameType::Welcome) => Some(State::Configured),
            (State::Ready, FrameType::Step) if !self.has_reset => {
                return Err(WireError::StepBeforeReset);
            }
            (State::Ready, FrameType::Reset | FrameType::Step) => Some(State::Stepping),
            (State::Ready, FrameType::Call) => Some(State::Calling),
            (State::Ready, FrameType::Ping) => Some(State::Pinging),
            _ => None,
        };
        self.follow(frame, following)?;
        self.has_reset |= frame == FrameType::Reset;
        Ok(())
    }

    /// Forgets that there was a `RESET`: the worlds must be reset again.
    pub fn require_reset(&mut self) {
        self.has_reset = false;
    }

    fn follow(&mut self, frame: FrameType, following: Option<State>) -> Result<(), WireError> {
        let state = self.state;
        self.state = following.ok_or(WireError::OutOfTurn { frame, state })?;
        Ok(())
    }
}
