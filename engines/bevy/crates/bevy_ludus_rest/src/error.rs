//! What can go wrong, for the people who write the game and for its clients.

use hyper::StatusCode;
use std::net::SocketAddr;

/// Why the game cannot be reached. It is printed when the app begins.
#[derive(Debug, thiserror::Error)]
pub(super) enum RestError {
    #[error(
        "the resource AIGymState is missing\nhint: call app.insert_resource(AIGymState::<Actions, \
         Observations>::new(settings)) before you add AIGymPlugin::<Actions, Observations>"
    )]
    NoState,
    #[error(
        "cannot listen at {address}: {source}\nhint: another game may be there; end it, or set \
         AIGymSettings {{ port: 0, .. }} and ask RestServer for the address"
    )]
    Listen {
        address: SocketAddr,
        source: std::io::Error,
    },
    #[error("cannot start the REST server: {0}")]
    Start(std::io::Error),
}

/// Why a client gets no answer: a status, and a reason in plain text.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Refusal {
    pub status: StatusCode,
    pub reason: String,
}

impl Refusal {
    pub fn new(status: StatusCode, reason: impl Into<String>) -> Self {
        let reason = reason.into();
        Self { status, reason }
    }

    pub fn bad_request(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, reason)
    }

    /// The sender may not play.
    pub fn forbidden(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, reason)
    }

    /// The game broke a rule.
    pub fn game(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, reason)
    }

    /// The app has ended.
    pub fn ended() -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "the game has ended")
    }
}
